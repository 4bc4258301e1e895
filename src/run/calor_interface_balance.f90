!> What leaves one material enters the other.
!>
!> Rows next to an interface are exact for fields that go on beyond it, each for itself: what two
!> particles on both sides give and take need not be the same. With H_i = w_i (ρc)_i for the area
!> w_i of a particle the heat Σ H_i T_i of an insulated body would stay if Σ_i H_i L_ij = 0 for all
!> j, dT_i/dt = Σ_j L_ij T_j. Rows that reach across an interface are multiplied by factors f_i:
!>
!>     Σ_i f_i H_i L_ij = 0 for all j that have such a row, f_i = 1 for all other rows,
!>
!> as many equations as factors. In one dimension rows of three points become those of finite
!> volumes with the harmonic mean of the conductivities. A row that is 0 for a field stays so, and
!> no sign changes. What it amounts to is that particles next to the interface exchange areas;
!> temperatures there are nearly the same, and the error is of second order, or, where sources
!> differ across the interface, of the first that it had anyway.
module calor_interface_balance
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  use calor_conduction, only: conduction_t
  use calor_kinds, only: wp
  use calor_sparse_operator, only: sparse_operator_t
  use calor_umfpack, only: factorisation_t
  implicit none (type, external)
  private

  public :: balance_interfaces

  !> No row is multiplied by less or more
  real(wp), parameter :: least = 0.2_wp, most = 3.0_wp

contains

  !> Multiply rows that reach across interfaces, and the weights of fluxes in them.
  subroutine balance_interfaces(conduction, area, across)
    !> The heat equation, whose rows are complete
    class(conduction_t), intent(inout) :: conduction
    !> Areas of the particles, m²
    real(wp), intent(in) :: area(:)
    !> Which rows of its Laplacian reach across an interface
    logical, intent(in) :: across(:)
    type(factorisation_t) :: factors
    integer, allocatable :: chosen(:), member(:), place(:), length(:), index(:), first(:)
    real(wp), allocatable :: value(:), right_side(:), part(:), factor(:)
    integer :: k, row, before, m
    logical :: done

    associate (rows => conduction%laplacian)
      chosen = pack([(k, k=1, size(across))], across)
      member = conduction%whole_number(rows%target(chosen))
      call conduction%join_counts(member)
      m = size(member)
      if (m == 0) return
      place = places_of(member, conduction%whole_number([(k, k=1, size(area))]))

      allocate (right_side(m), source=0.0_wp)
      allocate (length(0), index(0), value(0))
      do row = 1, rows%rows()
        associate (i => rows%target(row))
          associate (heat => area(i)*conduction%medium%capacity_of(int(i)))
            if (across(row)) then
              before = size(index)
              call append_row(rows, row, heat)
              length = [length, size(index) - before]
            else
              call add_row(rows, row, heat)
            end if
          end associate
        end associate
      end do
      ! Rows at held particles are not divided by their capacity.
      associate (held => conduction%held_rows)
        do row = 1, held%rows()
          call add_row(held, row, area(held%target(row)))
        end do
      end associate
      call conduction%join_counts(length)
      call conduction%join_counts(index)
      call conduction%join_reals(value)
      part = right_side
      call conduction%join_reals(part)
      right_side = -sum(reshape(part, [m, size(part)/m]), dim=2)
      ! A body that is nothing but interfaces
      if (all(abs(right_side) <= 0)) return

      first = [1, (0, k=1, m)]
      do k = 1, m
        first(k + 1) = first(k) + length(k)
      end do
      call factors%factorise(first, index, value, done)
      if (.not. done) return
      allocate (factor(m))
      call factors%solve(right_side, factor, .true., done)
      call factors%release()
      if (.not. done) return
      if (.not. all(ieee_is_finite(factor))) return
      factor = min(most, max(least, factor))
      do k = 1, size(chosen)
        associate (from => rows%first(chosen(k)), to => rows%first(chosen(k) + 1) - 1, &
                   own => factor(place(rows%target(chosen(k)))))
          rows%weight(from:to) = own*rows%weight(from:to)
          rows%diagonal(chosen(k)) = own*rows%diagonal(chosen(k))
          associate (contacts => conduction%medium%contacts)
            if (.not. allocated(contacts%weight)) cycle
            where (contacts%particle == rows%target(chosen(k)))
              contacts%weight = own*contacts%weight
            end where
          end associate
        end associate
      end do
    end associate

  contains

    !> Σ_i H_i L_ij of a row whose factor is 1
    subroutine add_row(operator, row, heat)
      type(sparse_operator_t), intent(in) :: operator
      integer, intent(in) :: row
      real(wp), intent(in) :: heat
      integer :: k

      associate (own => place(operator%target(row)))
        if (own > 0) right_side(own) = right_side(own) + heat*operator%diagonal(row)
      end associate
      do k = int(operator%first(row)), int(operator%first(row + 1)) - 1
        associate (j => place(operator%index(k)))
          if (j > 0) right_side(j) = right_side(j) + heat*operator%weight(k)
        end associate
      end do
    end subroutine add_row

    !> The same of one whose factor is sought
    subroutine append_row(operator, row, heat)
      type(sparse_operator_t), intent(in) :: operator
      integer, intent(in) :: row
      real(wp), intent(in) :: heat
      integer, allocatable :: column(:)
      real(wp), allocatable :: weight(:)

      associate (from => operator%first(row), to => operator%first(row + 1) - 1)
        column = place([operator%target(row), operator%index(from:to)])
        weight = heat*[operator%diagonal(row), operator%weight(from:to)]
      end associate
      index = [index, pack(column, column > 0)]
      value = [value, pack(weight, column > 0)]
    end subroutine append_row

  end subroutine balance_interfaces

  !> Where numbers stand in a list, 0 where they do not
  pure function places_of(list, number) result(place)
    integer, intent(in) :: list(:), number(:)
    integer :: place(size(number))
    integer :: inverse(maxval(number)), k

    inverse = 0
    do k = 1, size(list)
      if (list(k) <= size(inverse)) inverse(list(k)) = k
    end do
    place = inverse(number)
  end function places_of

end module calor_interface_balance
