!> The schemes that a convergence study measures, and what its theory has to know of each.
!>
!> Every scheme of the tables `gradient_choices` and `laplacian_choices` takes part, as a pair of
!> name and order. One that is not described below is measured all the same; only its theoretical
!> orders are then missing.
module calor_convergence_schemes
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t
  use calor_gradient_scheme, only: gradient_scheme_t
  use calor_gradient_schemes, only: gradient_choices, make_gradient_scheme
  use calor_kernel, only: kernel_t
  use calor_kinds, only: wp
  use calor_laplacian_scheme, only: laplacian_scheme_t
  use calor_laplacian_schemes, only: laplacian_choices, make_laplacian_scheme
  use calor_neighbour_list, only: neighbour_list_t
  use calor_row_report, only: row_report_t
  use calor_sufficient_rows, only: assemble_sufficient_gradient, assemble_sufficient_laplacian
  use calor_sparse_operator, only: sparse_operator_t
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: study_scheme_t, study_schemes, gradient_family, laplacian_family, family_names

  !> A family is the order of its derivative
  integer, parameter :: gradient_family = 1, laplacian_family = 2
  character(len=9), parameter :: family_names(*) = [character(len=9) :: 'gradient', 'laplacian']

  !> A scheme, and its properties from the paper and docs/convergence.md
  type :: study_scheme_t
    !> `gradient_family` or `laplacian_family`
    integer :: family = 0
    !> Its name in the table of that family
    character(len=32) :: name = ''
    !> Which of the scheme's orders; 0 for a scheme that has but one
    integer :: order = 0
    !> Whether what follows is known, so that orders can be predicted
    logical :: understood = .false.
    !> Polynomials up to this degree are differentiated exactly on every cloud; -1: none are
    integer :: exact_degree = -1
    !> … and those up to this one on lattices
    integer :: lattice_degree = -1
    !> How often the weights differentiate the kernel
    integer :: kernel_derivatives = 1
    !> Whether the weights hang on the nearest neighbours, however wide the support
    logical :: compact = .false.
    !> Whether the paper analyses it
    logical :: of_paper = .false.
    !> It is measured from this support radius on, in spacings, if the scene's is smaller
    real(wp) :: least_support = 0.0_wp
    !> By how much the spacing shrinks from each refinement to the next
    real(wp) :: shrinking = 2.0_wp
    !> Whether it is measured on short waves
    logical :: short_waves = .false.
  contains
    !> The name, with the order where there are several
    procedure :: label
    !> The last term of the Taylor expansion that its truncation error needs
    procedure :: last_term
    !> The rows of weights: ∂/∂x and ∂/∂y, or ∇²
    procedure :: assemble
  end type study_scheme_t

  !> What is known of the schemes with one order
  type(study_scheme_t), parameter :: known(*) = [ &
      study_scheme_t(1, 'standard', 0, .true., -1, -1, 1, .false., .true.), &
      study_scheme_t(1, 'difference', 0, .true., 0, 0, 1, .false., .true.), &
      study_scheme_t(1, 'sum', 0, .true., -1, -1, 1, .false., .true.), &
      study_scheme_t(1, 'renormalized', 0, .true., 1, 1, 1, .false., .true.), &
      study_scheme_t(2, 'kernel_second_derivative', 0, .true., 0, 0, 2, .false., .true.), &
      study_scheme_t(2, 'double_gradient', 0, .true., 1, 2, 1, .false., .true.), &
      study_scheme_t(2, 'brookshaw', 0, .true., 0, 0, 1, .false., .true.), &
      study_scheme_t(2, 'brookshaw_renormalized', 0, .true., 0, 2, 1, .false., .true.), &
      study_scheme_t(2, 'fatehi_manzari', 0, .true., 2, 2, 1, .false., .true.), &
      study_scheme_t(2, 'positive', 0, .true., 2, 2, 1, .true., .false.) &
      ]

contains

  !> All pairs of scheme and order, gradients first, in the order of the tables.
  function study_schemes() result(schemes)
    type(study_scheme_t), allocatable :: schemes(:)
    integer :: k

    allocate (schemes(0))
    do k = 1, size(gradient_choices)
      schemes = [schemes, pairs(gradient_family, gradient_choices(k)%name)]
    end do
    do k = 1, size(laplacian_choices)
      schemes = [schemes, pairs(laplacian_family, laplacian_choices(k)%name)]
    end do
  end function study_schemes

  !> The pairs of one scheme; none if its name alone does not make it.
  function pairs(family, name) result(schemes)
    integer, intent(in) :: family
    character(len=*), intent(in) :: name
    type(study_scheme_t), allocatable :: schemes(:)
    class(gradient_scheme_t), allocatable :: gradient
    class(laplacian_scheme_t), allocatable :: laplacian
    type(error_t), allocatable :: impossible
    integer :: k

    select case (name)
    case ('consistent')
      schemes = [(consistent_scheme(family, k), k=2, 8, 2)]
    case default
      schemes = pack(known, known%family == family .and. known%name == name)
      if (size(schemes) > 0) return
      schemes = [study_scheme_t(family=family, name=name)]
      if (family == gradient_family) then
        call make_gradient_scheme(trim(name), gradient, impossible)
      else
        call make_laplacian_scheme(trim(name), laplacian, impossible)
        if (.not. allocated(impossible)) schemes%exact_degree = laplacian%exact_degree()
      end if
      if (allocated(impossible)) schemes = schemes(1:0)
    end select
  end function pairs

  !> The Laplacian is exact for one degree more than the gradient of the same order. Supports are
  !> wider than `natural_support`, so that rows need not grow and shrink with h as theory has it.
  !> Errors of high order would soon vanish in rounding: they are measured on short waves, and with
  !> smaller steps of refinement.
  pure function consistent_scheme(family, order) result(scheme)
    integer, intent(in) :: family, order
    type(study_scheme_t) :: scheme

    scheme = study_scheme_t(family=family, name='consistent', order=order, understood=.true., &
                            exact_degree=order + family - 1, lattice_degree=order + family - 1, &
                            least_support=1.5_wp + 0.75_wp*order)
    if (order <= 2) return
    scheme%shrinking = sqrt(2.0_wp)
    scheme%short_waves = .true.
  end function consistent_scheme

  pure function label(this) result(text)
    class(study_scheme_t), intent(in) :: this
    character(len=:), allocatable :: text

    text = trim(this%name)
    if (this%order > 0) text = text//' '//to_text(this%order)
  end function label

  !> Two beyond the exact degree, where lattices have their first term, and for short waves four
  !> more; at least the fourth.
  elemental function last_term(this) result(degree)
    class(study_scheme_t), intent(in) :: this
    integer :: degree

    degree = max(4, this%exact_degree + merge(6, 2, this%short_waves))
  end function last_term

  subroutine assemble(this, kernel, cloud, radius, list, rows, error)
    class(study_scheme_t), intent(in) :: this
    !> The smoothing kernel
    class(kernel_t), intent(in) :: kernel
    !> The cloud
    type(cloud_t), intent(in) :: cloud
    !> Support radii of all particles, m
    real(wp), intent(in) :: radius(:)
    !> The particles to assemble rows for, and their neighbours
    type(neighbour_list_t), intent(in) :: list
    !> As many operators as the family has components
    type(sparse_operator_t), allocatable, intent(out) :: rows(:)
    !> There is no such scheme
    type(error_t), allocatable, intent(out) :: error
    class(gradient_scheme_t), allocatable :: gradient
    class(laplacian_scheme_t), allocatable :: laplacian
    type(row_report_t) :: report
    real(wp), allocatable :: grown(:)

    if (this%family == gradient_family) then
      call make_gradient_scheme(trim(this%name), gradient, error, max(1, this%order))
      if (allocated(error)) return
      allocate (rows(2))
      if (this%order > 0) then
        grown = radius
        call assemble_sufficient_gradient(gradient, kernel, cloud%x, cloud%y, cloud%volume, grown, &
                                          list%target, rows(1), rows(2), report)
        return
      end if
      call gradient%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, rows(1), rows(2))
    else
      call make_laplacian_scheme(trim(this%name), laplacian, error, max(1, this%order))
      if (allocated(error)) return
      allocate (rows(1))
      if (this%order > 0) then
        grown = radius
        call assemble_sufficient_laplacian(laplacian, kernel, cloud%x, cloud%y, cloud%volume, &
                                           grown, list%target, rows(1), report)
        return
      end if
      call laplacian%assemble(kernel, cloud%x, cloud%y, cloud%volume, radius, list, rows(1))
    end if
  end subroutine assemble

end module calor_convergence_schemes
