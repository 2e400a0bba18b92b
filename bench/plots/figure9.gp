# Figure 9: the culled surface from the front and from the side.
#
# `gnuplot figure9.gp` in the folder of its data writes figure9.svg and figure9.png.
#
# figure9.csv: 1 isovalue, 2 triangles extracted, 3 triangles left out

set datafile separator comma
isovalue = 0
share = 0
note(level, extracted, left_out) = (isovalue = level, \
  share = extracted + left_out > 0 ? 100.0 * extracted / (extracted + left_out) : 0, 0)
stats 'figure9.csv' skip 1 using (note($1, $2, $3)) nooutput

unset border
unset tics
unset key
set size ratio -1
set margins 0,0,0,2
do for [format in 'svg png'] {
  if (format eq 'svg') {
    set terminal svg size 1260,460 background 'white'
  } else {
    set terminal pngcairo size 1260,460
  }
  set output 'figure9.'.format
  set multiplot layout 1,3
  set title sprintf('(a) isovalue %g, whole', isovalue)
  plot 'figure9_a_whole.png' binary filetype=png with rgbimage
  set title sprintf('(b) culled: %.1f %% of triangles', share)
  plot 'figure9_b_culled.png' binary filetype=png with rgbimage
  set title '(c) b from the side; red: not extracted'
  plot 'figure9_c_side.png' binary filetype=png with rgbimage
  unset multiplot
  unset output
}
