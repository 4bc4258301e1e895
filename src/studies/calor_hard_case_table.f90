!> The hard clouds and schemes as a report: a table for each scheme, and what follows from them.
module calor_hard_case_table
  use calor_cloud, only: cloud_t
  use calor_error, only: error_t
  use calor_hard_cases, only: hard_case_t, examine_cloud
  use calor_hard_clouds, only: jittered_square, random_square, doubled_square, holed_square, &
                               graded_square
  use calor_kinds, only: wp
  use calor_stable_rows, only: support_grown, positive_stencil, inexact_stencil, no_stencil
  use calor_text, only: to_text
  implicit none (type, external)
  private

  public :: write_hard_case_tables, hard_cloud, hard_cloud_count, hard_cloud_name

  !> Clouds are made with this many different random numbers, and the worst of them is reported
  integer, parameter :: seeds = 5
  real(wp), parameter :: jitters(*) = [0.1_wp, 0.2_wp, 0.3_wp, 0.45_wp]
  real(wp), parameter :: supports(*) = [1.2_wp, 1.5_wp, 2.1_wp, 2.6_wp, 3.1_wp]
  character(len=*), parameter :: special(*) = [character(len=7) :: 'random', 'doubled', 'holed', &
                                                                   'graded']
  !> Number of kinds of clouds
  integer, parameter :: hard_cloud_count = size(jitters)*size(supports) + size(special)
  !> Support radius of the special clouds, in spacings
  real(wp), parameter :: usual_support = 2.1_wp

  !> A scheme, with or without repair
  type :: entry_t
    character(len=15) :: scheme
    logical :: growth
    character(len=36) :: heading
  end type entry_t

  type(entry_t), parameter :: entries(*) = [ &
      entry_t('fatehi_manzari', .false., '`fatehi_manzari` as written'), &
      entry_t('fatehi_manzari', .true., '`fatehi_manzari`'), &
      entry_t('positive', .true., '`positive`'), &
      entry_t('brookshaw', .true., '`brookshaw`'), &
      entry_t('double_gradient', .true., '`double_gradient`') &
      ]

contains

  !> A hard cloud of the unit square by its number.
  subroutine hard_cloud(number, n, seed, cloud, support)
    !> Which kind, 1 to `hard_cloud_count`
    integer, intent(in) :: number
    !> Spacings along an edge
    integer, intent(in) :: n
    !> Which of all such clouds
    integer, intent(in) :: seed
    !> The cloud
    type(cloud_t), intent(out) :: cloud
    !> The support radius to try it with, in spacings
    real(wp), intent(out) :: support
    integer :: k

    k = number - size(jitters)*size(supports)
    support = usual_support
    if (k <= 0) then
      support = supports(1 + mod(number - 1, size(supports)))
      cloud = jittered_square(n, jitters(1 + (number - 1)/size(supports)), seed)
      return
    end if
    select case (special(k))
    case ('random')
      cloud = random_square(n, seed)
    case ('doubled')
      cloud = doubled_square(n, seed)
    case ('holed')
      cloud = holed_square(n, seed)
    case default
      cloud = graded_square(n, seed)
    end select
  end subroutine hard_cloud

  !> What a hard cloud is called.
  function hard_cloud_name(number) result(name)
    !> Which kind, 1 to `hard_cloud_count`
    integer, intent(in) :: number
    character(len=:), allocatable :: name
    integer :: k

    k = number - size(jitters)*size(supports)
    if (k > 0) then
      name = trim(special(k))
    else
      name = 'jitter '//to_text(jitters(1 + (number - 1)/size(supports)))//', h = '// &
             to_text(supports(1 + mod(number - 1, size(supports))))//' Δ'
    end if
  end function hard_cloud_name

  !> Examine all clouds with all schemes and write Markdown: conclusions first, then a table for
  !> each scheme. Each line stands for five clouds, and gives the worst of them.
  subroutine write_hard_case_tables(unit, n, error)
    !> An open unit
    integer, intent(in) :: unit
    !> Spacings along an edge
    integer, intent(in) :: n
    !> A study failed
    type(error_t), allocatable, intent(out) :: error
    type(hard_case_t) :: found
    type(cloud_t) :: cloud
    real(wp) :: support
    real(wp) :: growth(hard_cloud_count, size(entries)), deviation(hard_cloud_count, size(entries))
    real(wp) :: widest(hard_cloud_count, size(entries))
    integer :: repairs(support_grown:no_stencil, hard_cloud_count, size(entries))
    integer :: number, entry, seed

    growth = -huge(1.0_wp)
    deviation = 0
    widest = 0
    repairs = 0
    do number = 1, hard_cloud_count
      do seed = 1, seeds
        call hard_cloud(number, n, seed, cloud, support)
        do entry = 1, size(entries)
          call examine_cloud(cloud, trim(entries(entry)%scheme), support, entries(entry)%growth, &
                             found, error)
          if (allocated(error)) return
          growth(number, entry) = max(growth(number, entry), found%growth())
          deviation(number, entry) = max(deviation(number, entry), found%error)
          widest(number, entry) = max(widest(number, entry), found%largest_support)
          repairs(:, number, entry) = max(repairs(:, number, entry), found%repairs(support_grown:))
        end do
      end do
    end do
    call write_conclusions(unit, growth)
    do entry = 1, size(entries)
      write (unit, '(/,a,/)') '### '//trim(entries(entry)%heading)
      write (unit, '(a)') '| cloud | max Re λ Δ² | error of ∇² | rows with a grown support | '// &
        'positive | inexact | none | largest h/Δ |'
      write (unit, '(a)') '|---|---|---|---|---|---|---|---|'
      do number = 1, hard_cloud_count
        write (unit, '(a)') '| '//hard_cloud_name(number)//' | '// &
          to_text(growth(number, entry), digits=3)//' | '// &
          to_text(deviation(number, entry), digits=2)//' | '// &
          to_text(repairs(support_grown, number, entry))//' | '// &
          to_text(repairs(positive_stencil, number, entry))//' | '// &
          to_text(repairs(inexact_stencil, number, entry))//' | '// &
          to_text(repairs(no_stencil, number, entry))//' | '// &
          to_text(widest(number, entry), digits=2)//' |'
      end do
    end do
  end subroutine write_hard_case_tables

  !> For each scheme: on how many kinds of clouds it was stable.
  subroutine write_conclusions(unit, growth)
    integer, intent(in) :: unit
    !> The largest real part of an eigenvalue, times Δ², of each kind of cloud and scheme
    real(wp), intent(in) :: growth(:, :)
    integer :: entry, unstable

    do entry = 1, size(entries)
      unstable = count(growth(:, entry) >= 0)
      if (unstable == 0) then
        write (unit, '(a)') '- '//trim(entries(entry)%heading)//': stable on every cloud; '// &
          'max Re λ Δ² between '//to_text(minval(growth(:, entry)), digits=3)//' and '// &
          to_text(maxval(growth(:, entry)), digits=3)//'.'
      else
        write (unit, '(a)') '- '//trim(entries(entry)%heading)//': unstable on '// &
          to_text(unstable)//' of '//to_text(size(growth, 1))//' kinds of clouds, with '// &
          'max Re λ Δ² up to '//to_text(maxval(growth(:, entry)), digits=3)//'.'
      end if
    end do
  end subroutine write_conclusions

end module calor_hard_case_table
