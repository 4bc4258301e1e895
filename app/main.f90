program main
  implicit none (type, external)
  print '(a)', 'calor'
end program main
