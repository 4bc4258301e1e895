# The sheet of tin at its end: the temperature, mirrored at the line of symmetry, and the pool within the
# line where a half is liquid. Expects the variables data (x, y, temperature, liquid fraction), scratch
# and picture.

set terminal pngcairo size 1400,800 font 'DejaVu Sans,20' linewidth 1.5
set output picture

# The colours of inferno (S. van der Walt and N. Smith), whose lightness grows evenly
set palette defined (0 '#000004', 1 '#280b53', 2 '#65156e', 3 '#9f2a63', 4 '#d44842', 5 '#f57d15', \
  6 '#fac127', 7 '#fcffa4')
set palette maxcolors 64

# The lattice's own rows, joined to a surface
set dgrid3d 31,101 qnorm 8
set table scratch.'/pool'
set contour base
set cntrparam levels discrete 0.5
unset surface
splot data using ($1*1000):($2*1000):4
unset table
unset contour
unset dgrid3d

set size ratio -1
set xrange [0:50]
set yrange [-15:15]
set cbrange [293:573]
set xtics 10 out nomirror
set ytics 5 out nomirror
set xlabel 'x (mm)'
set ylabel 'y (mm)'
set cblabel 'temperature (K)' offset 1,0
set title 'A beam melts a track in a sheet of tin, at t = 3 s'
unset key
plot data using ($1*1000):($2*1000):3 with points pointtype 5 pointsize 1.6 palette, \
  data using ($1*1000):(-$2*1000):3 with points pointtype 5 pointsize 1.6 palette, \
  scratch.'/pool' using 1:2 with lines linecolor rgb '#ffffff' linewidth 2, \
  scratch.'/pool' using 1:(-$2) with lines linecolor rgb '#ffffff' linewidth 2
