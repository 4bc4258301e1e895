!> Reads back, with HDF5 itself, what a run has written.
module test_field_reader
  use, intrinsic :: iso_c_binding, only: c_ptr, c_loc
  use calor_hdf5, only: start_hdf5
  use calor_kinds, only: wp
  use hdf5, only: hid_t, hsize_t, h5dclose_f, h5dget_space_f, h5dopen_f, h5dread_f, &
                  h5f_acc_rdonly_f, h5fclose_f, h5fopen_f, h5kind_to_type, h5_real_kind, &
                  h5sclose_f, h5sget_simple_extent_dims_f, h5sget_simple_extent_ndims_f
  implicit none (type, external)
  private

  public :: reals_in_file

contains

  !> All numbers of a dataset, in the file's order; none where there is no such dataset.
  function reals_in_file(path, name) result(values)
    !> The file
    character(len=*), intent(in) :: path
    !> The dataset with its groups
    character(len=*), intent(in) :: name
    real(wp), allocatable, target :: values(:)
    integer(hid_t) :: file, dataset, space
    integer(hsize_t) :: extent(2), limit(2)
    type(c_ptr) :: address
    integer :: status, rank

    call start_hdf5(status)
    call h5fopen_f(path, h5f_acc_rdonly_f, file, status)
    if (status >= 0) call h5dopen_f(file, name, dataset, status)
    if (status < 0) then
      allocate (values(0))
      return
    end if
    call h5dget_space_f(dataset, space, status)
    call h5sget_simple_extent_ndims_f(space, rank, status)
    call h5sget_simple_extent_dims_f(space, extent(:rank), limit(:rank), status)
    allocate (values(product(extent(:rank))))
    address = c_loc(values)
    call h5dread_f(dataset, h5kind_to_type(wp, h5_real_kind), address, status)
    call h5sclose_f(space, status)
    call h5dclose_f(dataset, status)
    call h5fclose_f(file, status)
  end function reals_in_file

end module test_field_reader
