# Figure 6: triangles and time with and without culling.
#
# `gnuplot figure6.gp` in the folder of its data writes figure6.svg and figure6.png.
#
# figure6.csv: 1 culling, 2 isovalue, 5 triangles, 6 busy time of the agent in ms

set datafile separator comma
set xlabel 'isovalue'
set yrange [0:*]
set key top right
array panel_title[2] = ['(a) triangles extracted', '(b) busy time of the agent, ms']
do for [format in 'svg png'] {
  if (format eq 'svg') {
    set terminal svg size 1100,440 background 'white'
  } else {
    set terminal pngcairo size 1100,440
  }
  set output 'figure6.'.format
  set multiplot layout 1,2 title 'Figure 6: with and without culling, one agent on one thread'
  do for [panel=1:2] {
    set title panel_title[panel]
    plot for [culling in 'none depth mask'] 'figure6.csv' skip 1 \
      using (strcol(1) eq culling ? $2 : NaN):4 + panel with linespoints title 'culling '.culling
  }
  unset multiplot
  unset output
}
