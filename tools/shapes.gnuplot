# Particles in bodies of several shapes, one row of pictures for each shape, one column for each
# arrangement. Expects the variables scratch (a folder with files SHAPE_ARRANGEMENT.txt of x, y and 1
# on walls, 0 inside) and picture.

set terminal pngcairo size 1600,1640 font 'DejaVu Sans,18' linewidth 1.5
set output picture

shapes = 'rectangle disc annulus polygon'
arrangements = 'lattice hexagonal jittered relaxed'
set multiplot
set size ratio -1
unset key
unset tics
unset border
set lmargin 0
set rmargin 0
set tmargin 0
set bmargin 0
do for [row = 1:4] {
  do for [column = 1:4] {
    set origin 0.045 + 0.242*(column - 1), 0.745 - 0.242*(row - 1)
    set size 0.215, 0.215
    set size ratio -1
    unset label
    if (row == 1) { set label 1 word(arrangements, column) at graph 0.5, graph 1.12 center }
    if (column == 1) { set label 2 word(shapes, row) at graph -0.08, graph 0.5 center rotate by 90 }
    data = scratch.'/'.word(shapes, row).'_'.word(arrangements, column).'.txt'
    plot data using 1:($3 < 0.5 ? $2 : NaN) with points pointtype 7 pointsize 0.75 \
        linecolor rgb '#21708e', \
      data using 1:($3 > 0.5 ? $2 : NaN) with points pointtype 7 pointsize 0.75 \
        linecolor rgb '#b2501e'
  }
}
unset multiplot
