# Figure 8: the stages of the picture, a row for each isovalue. The whole surface is left out: it
# looks like the final stage.
#
# `gnuplot figure8.gp` in the folder of its data writes figure8.svg and figure8.png.
#
# figure8.csv: 1 isovalue, 2 stage, 5 share of the triangles, 7 file name of the picture

set datafile separator comma

# Titles and file names of the pictures, each in quotes.
titles = ''
pictures = ''
quoted(text) = ' "'.text.'"'
note(title, picture) = (titles = titles.quoted(title), pictures = pictures.quoted(picture), 0)
stats 'figure8.csv' skip 1 using (strcol(2) eq 'whole' || strcol(2) eq 'own a pixel' ? 0 : \
  note(sprintf('isovalue %g, %s: %.1f %% of triangles', $1, strcol(2), 100 * $5), strcol(7))) \
  nooutput
rows = words(pictures) > 3 ? words(pictures) / 3 : 1

unset border
unset tics
unset key
set size ratio -1
set margins 0,0,0,2
do for [format in 'svg png'] {
  if (format eq 'svg') {
    set terminal svg size 1260,460 * rows background 'white'
  } else {
    set terminal pngcairo size 1260,460 * rows
  }
  set output 'figure8.'.format
  set multiplot layout rows,3
  do for [i=1:words(pictures)] {
    set title word(titles, i)
    plot word(pictures, i) binary filetype=png with rgbimage
  }
  unset multiplot
  unset output
}
