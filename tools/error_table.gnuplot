# The error of the heat problem against the spacing. Expects the variables data (the Markdown table of
# the example error_table) and picture.

set terminal pngcairo size 1400,1050 font 'DejaVu Sans,22' linewidth 2
set output picture

set datafile separator '|'
set logscale xy
set xrange [0.0105:0.24]
set yrange [1e-4:0.4]
set xtics ('1/80' 1.0/80, '1/40' 1.0/40, '1/20' 1.0/20, '1/10' 1.0/10)
set ytics nomirror out
set xtics nomirror out
set format y '10^{%T}'
set grid xtics ytics linecolor '#dddddd' linetype 1 linewidth 0.5
set border 3
set xlabel 'distance between particles Δ (m)'
set ylabel 'relative L_2 error of the temperature at t = 0.05 s'
set title 'Heat problem of the unit square (Wendland C2, h = 2.1 Δ)'
unset key

usual = '#b2501e'
paper = '#21708e'

# What second order looks like
set object polygon from 0.0155,3e-3 to 0.031,1.2e-2 to 0.031,3e-3 to 0.0155,3e-3 \
  fillstyle empty border linecolor '#666666' linewidth 1
set label '1' at 0.0215,2.5e-3 center textcolor rgb '#666666'
set label '2' at 0.0325,6e-3 left textcolor rgb '#666666'

set label "brookshaw,\nirregular cloud" at 0.108,1.16e-1 left textcolor rgb usual
set label "brookshaw,\nlattice" at 0.108,4.3e-2 left textcolor rgb usual
set label "fatehi\\_manzari,\nirregular cloud\nand lattice" at 0.108,1.75e-2 left textcolor rgb paper

plot data using (1/$2):5 with linespoints linecolor rgb usual pointtype 7 pointsize 2, \
  data using (1/$2):3 with linespoints linecolor rgb usual dashtype 2 pointtype 6 pointsize 2, \
  data using (1/$2):6 with linespoints linecolor rgb paper pointtype 7 pointsize 2, \
  data using (1/$2):4 with linespoints linecolor rgb paper dashtype 2 pointtype 6 pointsize 3
