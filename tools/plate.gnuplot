# The temperature of the plate at its end: as a smooth map with lines of equal temperature, and the
# particles that carry it. Expects the variables data (x, y, temperature), scratch and picture.

set terminal pngcairo size 1200,1030 font 'DejaVu Sans,20' linewidth 1.5
set output picture

# The colours of viridis (S. van der Walt and N. Smith), whose lightness grows evenly
set palette defined (0 '#440154', 1 '#472c7a', 2 '#3b518b', 3 '#2c718e', 4 '#21908d', 5 '#27ad81', \
  6 '#5cc863', 7 '#aadc32', 8 '#fde725')
set palette maxcolors 64

# A smooth surface through the particles' temperatures, on a grid
set dgrid3d 201,201 splines
set table scratch.'/surface'
splot data using 1:2:3
unset table
set contour base
set cntrparam levels incremental 0.05, 0.05, 0.35
unset surface
set table scratch.'/contours'
splot data using 1:2:3
unset table
unset dgrid3d
unset contour

set size ratio -1
set xrange [0:1]
set yrange [0:1]
set cbrange [0:0.4]
set xtics 0.2 out nomirror
set ytics 0.2 out nomirror
set cbtics 0.1
set xlabel 'x (m)'
set ylabel 'y (m)'
set cblabel 'temperature (K)' offset 1,0
set title 'Plate with walls held at 0 K, at t = 0.05 s'
unset key
plot scratch.'/surface' using 1:2:3 with image, \
  data using 1:2 with points pointtype 7 pointsize 0.35 linecolor rgb '#000000', \
  scratch.'/contours' using 1:2 with lines linecolor rgb '#ffffff' linewidth 1.2
