!> Hard clouds: what schemes make of them.
!>
!>     hard_cases              three lines about one cloud
!>     hard_cases all          the tables of docs/hard-cases.md (minutes)
!>     hard_cases spectrum     eigenvalues of a cloud before and after repair, times Δ²
!>     hard_cases cloud K N S  hard cloud number K, N spacings to an edge, seed S, as CSV
program hard_cases
  use, intrinsic :: iso_fortran_env, only: output_unit
  use calor, only: cloud_t, error_t, wp
  use calor_hard_case_table, only: write_hard_case_tables, hard_cloud, hard_cloud_name
  use calor_hard_cases, only: hard_case_t, examine_cloud
  implicit none (type, external)

  type(error_t), allocatable :: error
  type(hard_case_t) :: found
  type(cloud_t) :: cloud
  real(wp) :: support
  character(len=16) :: word(4)
  integer :: k, kind, n, seed

  word = ''
  do k = 1, command_argument_count()
    call get_command_argument(k, word(k))
  end do
  select case (word(1))
  case ('all')
    call write_hard_case_tables(output_unit, 24, error)
  case ('cloud')
    read (word(2:4), *) kind, n, seed
    call hard_cloud(kind, n, seed, cloud, support)
    print '(a)', '# '//hard_cloud_name(kind)//', made by: hard_cases cloud '// &
      trim(word(2))//' '//trim(word(3))//' '//trim(word(4))
    print '(a)', 'x,y,volume,wall'
    do k = 1, cloud%particles()
      print '(2(f0.17,","),es23.16,",",i0)', cloud%x(k), cloud%y(k), cloud%volume(k), &
        merge(1, 0, cloud%side(k) /= 0)
    end do
  case default
    ! Jitter 0.45 and h = 1.5 Δ: hardly any row of the scheme is stable as written.
    do kind = 0, 1
      call hard_cloud(17, 24, 1, cloud, support)
      call examine_cloud(cloud, 'fatehi_manzari', support, kind == 1, found, error)
      if (allocated(error)) exit
      if (word(1) == 'spectrum') then
        print '(2es16.7)', (found%real_part(k), found%imaginary_part(k), k=1, size(found%real_part))
        print '(/)'
        cycle
      end if
      if (kind == 0) print '(a)', hard_cloud_name(17)//', fatehi_manzari, 24 spacings to an edge'
      print '(a,i0,a,f0.4,a,f0.3)', 'repaired rows ', found%repaired(), &
        ': largest Re λ Δ² ', found%growth(), ', relative error of the Laplacian ', found%error
    end do
  end select
  if (allocated(error)) error stop 1
end program hard_cases
