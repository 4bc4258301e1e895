# Bytes that ranks exchange against the particles of a rank. Expects the variables data (ranks,
# particles of a rank, of others, bytes at most, bytes on average) and picture.

set terminal pngcairo size 1200,800 font 'DejaVu Sans,22' linewidth 2
set output picture
set border 3
set tics out nomirror
set grid linecolor '#dddddd' linetype 1 linewidth 0.5
set logscale xy
set xlabel 'particles of a rank'
set ylabel 'bytes for a product with the Laplacian'
set key top left
plot data using ($1 > 1 ? $2 : NaN):4 with linespoints pointtype 7 linecolor '#b2501e' \
    title 'to a rank, at most', \
  data using ($1 > 1 ? $2 : NaN):5 with linespoints pointtype 7 linecolor '#21708e' \
    title 'on average', \
  8*4*2.1*sqrt(x) with lines dashtype 2 linecolor '#444444' title '8 · 4 √(N/P) h/Δ'
