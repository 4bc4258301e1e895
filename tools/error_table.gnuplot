# The error of the heat problem against the spacing. Expects the variables data (jitter, 1/Δ and the
# errors of brookshaw and fatehi_manzari) and picture.

set terminal pngcairo size 1400,1050 font 'DejaVu Sans,22' linewidth 2
set output picture

set logscale xy
set xrange [0.0108:0.105]
set yrange [1e-4:0.4]
set xtics ('1/80' 1.0/80, '1/40' 1.0/40, '1/20' 1.0/20)
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
set object polygon from 0.0145,2e-3 to 0.0261,6.48e-3 to 0.0261,2e-3 to 0.0145,2e-3 \
  fillstyle empty border linecolor '#666666' linewidth 1
set label '1' at 0.0195,1.72e-3 center textcolor rgb '#666666'
set label '2' at 0.0269,3.6e-3 left textcolor rgb '#666666'

# Names stand beside the points of the coarsest cloud.
beside(n) = n == 20 ? 0.054 : NaN
cloud(jitter) = sprintf("<awk '$1 == %s' %s", jitter, data)
lattice = cloud('0')
irregular = cloud('0.2')

plot irregular using (1/$2):3 with linespoints linecolor rgb usual pointtype 7 pointsize 2, \
  lattice using (1/$2):3 with linespoints linecolor rgb usual dashtype 2 pointtype 6 pointsize 2, \
  irregular using (1/$2):4 with linespoints linecolor rgb paper pointtype 7 pointsize 2, \
  lattice using (1/$2):4 with linespoints linecolor rgb paper dashtype 2 pointtype 6 pointsize 3, \
  irregular using (beside($2)):3:("brookshaw,\nirregular cloud") with labels left textcolor rgb usual, \
  lattice using (beside($2)):3:("brookshaw,\nlattice") with labels left textcolor rgb usual, \
  lattice using (beside($2)):4:("fatehi_manzari,\nirregular cloud\nand lattice") with labels left \
    noenhanced textcolor rgb paper
