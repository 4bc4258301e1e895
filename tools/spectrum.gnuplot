# The spectrum of the heat equation on a hard cloud before and after the repair of rows. Expects the
# variables data (two blocks of real and imaginary parts) and picture.

set terminal pngcairo size 1500,1100 font 'DejaVu Sans,22' linewidth 2
set output picture

before = '#b2501e'
after = '#21708e'

stats data using 1 index 0 name 'A' nooutput
stats data using 1 index 1 name 'B' nooutput
unstable = system(sprintf("awk 'BEGIN { block = 0 } /^$/ { block = 1 } NF == 2 && block == 0 && $1 > 0' %s | wc -l", data))

set multiplot
set border 3
set tics out nomirror
set grid linecolor '#dddddd' linetype 1 linewidth 0.5
unset key
set ylabel 'Im λ Δ²' offset 1,0
set label 1 at graph 0, graph 1.09 left textcolor rgb '#333333'

# Both axes show the inverse hyperbolic sine: linear about 0, logarithmic beyond
show(v) = asinh(v)
set lmargin at screen 0.095
set rmargin at screen 0.975
set xrange [asinh(-6000):asinh(3000)]
set xtics ('-1000' asinh(-1000), '-100' asinh(-100), '-10' asinh(-10), '-1' asinh(-1), '0' 0, \
  '1' asinh(1), '10' asinh(10), '100' asinh(100), '1000' asinh(1000))
set ytics ('-5' asinh(-5), '-1' asinh(-1), '0' 0, '1' asinh(1), '5' asinh(5))
set arrow 1 from 0, graph 0 to 0, graph 1 nohead linecolor rgb '#444444' linewidth 1
set object 1 rectangle from graph 0, graph 0 to 0, graph 1 behind fillcolor rgb '#e7f1ea' \
  fillstyle solid noborder
set label 2 'stable' at -0.1, graph 0.06 right textcolor rgb '#3b7a4e'
set label 3 'unstable' at 0.1, graph 0.06 left textcolor rgb '#b2501e'

set tmargin at screen 0.865
set bmargin at screen 0.58
set yrange [asinh(-12):asinh(12)]
set title 'All 529 eigenvalues of fatehi\_manzari, jitter 0.45, h = 1.5 Δ' font ',24' offset 0,1.8
set label 1 sprintf('As written: %s of them unstable, the rightmost at Re λ Δ² = %.0f', unstable, A_max)
plot data index 0 using (show($1)):(show($2)) with points pointtype 7 pointsize 1.1 linecolor rgb before

unset title
set label 1 textcolor rgb '#333333'
set tmargin at screen 0.40
set bmargin at screen 0.115
set xlabel 'Re λ Δ²'
set label 1 sprintf('With repaired rows: none unstable, the rightmost at Re λ Δ² = %.4f (exact: -0.0343)', B_max)
plot data index 1 using (show($1)):(show($2)) with points pointtype 7 pointsize 1.1 linecolor rgb after
unset multiplot
