!> The particles of other ranks within reach of one's own.
!>
!> A square of the Hilbert curve is one stretch of it. So each rank knows, from the bands' first
!> keys alone, who has the particles of a square that it wants, and asks only these.
module calor_halo
  use calor_cloud, only: cloud_t
  use calor_curve_bands, only: bands_t, first_not_below
  use calor_kinds, only: wp, ip, i8
  use calor_particle_exchange, only: exchange_particles
  use calor_ranks, only: ranks_t
  use calor_space_filling_curve, only: hilbert_key, levels, sort_by_keys
  implicit none (type, external)
  private

  public :: add_halo

contains

  !> Join the own particles with all others within reach, in the order of the whole.
  subroutine add_halo(ranks, bands, own, reach, cloud, number)
    type(ranks_t), intent(in) :: ranks
    type(bands_t), intent(in) :: bands
    !> The own particles, along the curve
    type(cloud_t), intent(in) :: own
    !> How far it has to reach from this rank's particles, m; a little more may come
    real(wp), intent(in) :: reach
    !> All, with the own ones marked
    type(cloud_t), intent(out) :: cloud
    !> Their numbers in the whole, from 1, ascending
    integer(i8), allocatable, intent(out) :: number(:)
    type(cloud_t) :: arrived
    integer(i8), allocatable :: wanted(:), asked(:), own_number(:), arrived_number(:)
    integer(ip), allocatable :: order(:)
    integer, allocatable :: chosen(:)
    integer :: sent(ranks%ranks), received(ranks%ranks), bits, k

    associate (longest => ranks%most(reach))
      bits = min(levels - 1, max(0, exponent(0.5_wp*longest*bands%square%per_length) - 1))
    end associate
    call find_squares(ranks, bands, own, reach, bits, wanted, sent)
    call ranks%announce(sent, received)
    allocate (asked(sum(received)))
    call ranks%exchange(sent, wanted, received, asked)
    call choose_particles(bands, bits, received, asked, chosen, sent)
    own_number = [(bands%before(ranks%rank) + k, k=1, own%particles())]
    call exchange_particles(ranks, own, chosen, sent, own_number, arrived, arrived_number)

    cloud = own
    call append(cloud, arrived)
    number = [own_number, arrived_number]
    call sort_by_keys(number, order)
    call cloud%reorder(order)
    cloud%is_part = .true.
    cloud%own_first = first_not_below(number, bands%before(ranks%rank) + 1)
    cloud%own_last = cloud%own_first + own%particles() - 1
  end subroutine add_halo

  !> The squares that have to be asked for, rank after rank: those within reach of squares with own
  !> particles, unless they are wholly one's own.
  subroutine find_squares(ranks, bands, own, reach, bits, wanted, sent)
    type(ranks_t), intent(in) :: ranks
    type(bands_t), intent(in) :: bands
    type(cloud_t), intent(in) :: own
    real(wp), intent(in) :: reach
    !> A square has an edge of 2^bits of the finest ones
    integer, intent(in) :: bits
    integer(i8), allocatable, intent(out) :: wanted(:)
    !> How many go to each rank
    integer, intent(out) :: sent(:)
    integer(i8), allocatable :: square(:), list(:)
    integer(i8) :: column, row, c, r, last, margin, key
    integer :: k, pass, used, rank
    integer, allocatable :: to(:), place(:)

    ! A square more than the reach, for particles may lie anywhere in theirs
    margin = ceiling(reach*bands%square%per_length*(1 + 1.0e-9_wp)/2.0_wp**bits, i8)
    last = 2_i8**(levels - bits) - 1
    allocate (square(0))
    do pass = 1, 2
      used = 0
      do k = 1, own%particles()
        if (k > 1) then
          if (ishft(bands%key(k), -2*bits) == ishft(bands%key(k - 1), -2*bits)) cycle
        end if
        column = ishft(int((own%x(k) - bands%square%x)*bands%square%per_length, i8), -bits)
        row = ishft(int((own%y(k) - bands%square%y)*bands%square%per_length, i8), -bits)
        do c = max(0_i8, column - margin), min(last, column + margin)
          do r = max(0_i8, row - margin), min(last, row + margin)
            key = ishft(hilbert_key(ishft(c, bits), ishft(r, bits)), -2*bits)
            if (ishft(key, 2*bits) >= bands%first_key(ranks%rank) .and. &
                ishft(key + 1, 2*bits) <= bands%first_key(ranks%rank + 1)) cycle
            used = used + 1
            if (pass == 2) square(used) = key
          end do
        end do
      end do
      if (pass == 1) then
        deallocate (square)
        allocate (square(used))
      end if
    end do
    call keep_different(square)
    ! A square may belong to several ranks, which stand in order as squares do.
    allocate (list(0), to(0))
    do pass = 1, 2
      used = 0
      do k = 1, size(square)
        do rank = bands%owner(ishft(square(k), 2*bits)), bands%owner(ishft(square(k) + 1, &
                                                                           2*bits) - 1)
          if (rank == ranks%rank) cycle
          used = used + 1
          if (pass == 1) cycle
          list(used) = square(k)
          to(used) = rank + 1
        end do
      end do
      if (pass == 1) then
        deallocate (list, to)
        allocate (list(used), to(used))
      end if
    end do
    sent = 0
    do k = 1, used
      sent(to(k)) = sent(to(k)) + 1
    end do
    allocate (wanted(used), place(size(sent)))
    place(1) = 1
    do rank = 2, size(sent)
      place(rank) = place(rank - 1) + sent(rank - 1)
    end do
    do k = 1, used
      wanted(place(to(k))) = list(k)
      place(to(k)) = place(to(k)) + 1
    end do
  end subroutine find_squares

  subroutine keep_different(keys)
    integer(i8), allocatable, intent(inout) :: keys(:)
    integer(ip), allocatable :: order(:)
    logical, allocatable :: differs(:)

    call sort_by_keys(keys, order)
    allocate (differs(size(keys)), source=.true.)
    if (size(keys) > 1) differs(2:) = keys(2:) /= keys(:size(keys) - 1)
    keys = pack(keys, differs)
  end subroutine keep_different

  !> The own particles in the squares that others ask for.
  subroutine choose_particles(bands, bits, received, asked, chosen, sent)
    type(bands_t), intent(in) :: bands
    integer, intent(in) :: bits
    !> How many squares each rank asks for, and these
    integer, intent(in) :: received(:)
    integer(i8), intent(in) :: asked(:)
    !> The particles, rank after rank, and how many go to each
    integer, allocatable, intent(out) :: chosen(:)
    integer, intent(out) :: sent(:)
    integer :: k, pass, rank, used, from, to, i, asked_before

    allocate (chosen(0))
    do pass = 1, 2
      used = 0
      asked_before = 0
      do rank = 1, size(received)
        sent(rank) = used
        do k = asked_before + 1, asked_before + received(rank)
          from = first_not_below(bands%key, ishft(asked(k), 2*bits))
          to = first_not_below(bands%key, ishft(asked(k) + 1, 2*bits)) - 1
          if (pass == 2) chosen(used + 1:used + 1 + to - from) = [(i, i=from, to)]
          used = used + 1 + to - from
        end do
        asked_before = asked_before + received(rank)
        sent(rank) = used - sent(rank)
      end do
      if (pass == 1) then
        deallocate (chosen)
        allocate (chosen(used))
      end if
    end do
  end subroutine choose_particles

  !> Put the particles of another cloud behind those of one.
  subroutine append(cloud, others)
    type(cloud_t), intent(inout) :: cloud
    type(cloud_t), intent(in) :: others

    cloud%x = [cloud%x, others%x]
    cloud%y = [cloud%y, others%y]
    cloud%volume = [cloud%volume, others%volume]
    cloud%area = [cloud%area, others%area]
    cloud%side = [cloud%side, others%side]
    cloud%user_index = [cloud%user_index, others%user_index]
    if (.not. allocated(cloud%normal_x)) return
    cloud%normal_x = [cloud%normal_x, others%normal_x]
    cloud%normal_y = [cloud%normal_y, others%normal_y]
    cloud%wall_length = [cloud%wall_length, others%wall_length]
  end subroutine append

end module calor_halo
