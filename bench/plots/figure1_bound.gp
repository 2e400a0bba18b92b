# Theorem 2.2: the triangles of the agent that has most, beside the bound; one panel for each number
# of agents.
#
# `gnuplot figure1_bound.gp` in the folder of its data writes figure1_bound.svg and
# figure1_bound.png.
#
# figure1_bound.csv: 1 distribution, 2 agents, 3 isovalue, 5 mean, 6 most and 7 bound of the
# triangles of an agent, 10 whether the premise of the theorem holds

data = 'figure1_bound.csv'
set datafile separator comma

# The numbers of agents, each once, in the order of the file: ' 2 4 8'.
counts = ''
note(n) = (counts = strstrt(counts.' ', sprintf(' %d ', n)) ? counts : counts.sprintf(' %d', n), n)
stats data skip 1 using (note($2)) nooutput

panels = words(counts) > 0 ? words(counts) : 1
columns = panels < 3 ? panels : 3
rows = (panels + columns - 1) / columns

set xlabel 'isovalue'
set yrange [0:*]
set key top right
do for [format in 'svg png'] {
  if (format eq 'svg') {
    set terminal svg size 420 * columns,360 * rows background 'white'
  } else {
    set terminal pngcairo size 420 * columns,360 * rows
  }
  set output 'figure1_bound.'.format
  set multiplot layout rows,columns \
    title 'Theorem 2.2: the bound and the agent with the most triangles'
  do for [count in counts] {
    set title count.' agents: triangles'
    plot \
      data skip 1 using (strcol(1) eq 'random' && $2 == count + 0 ? $3 : NaN):7 \
        with lines dashtype 2 linecolor 'grey50' title '2 W / P', \
      data skip 1 using (strcol(1) eq 'random' && $2 == count + 0 && $10 == 1 ? $3 : NaN):7 \
        with points pointtype 7 linecolor 'grey50' title 'premise holds', \
      data skip 1 using (strcol(1) eq 'random' && $2 == count + 0 ? $3 : NaN):5 \
        with lines linecolor 'black' title 'mean', \
      data skip 1 using (strcol(1) eq 'random' && $2 == count + 0 ? $3 : NaN):6 \
        with linespoints linecolor 1 title 'most, random', \
      data skip 1 using (strcol(1) eq 'greedy' && $2 == count + 0 ? $3 : NaN):6 \
        with linespoints linecolor 2 title 'most, greedy'
  }
  unset multiplot
  unset output
}
