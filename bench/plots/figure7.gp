# Figure 7: the busy time of each agent, and the speed-up over one agent.
#
# `gnuplot figure7.gp` in the folder of its data writes figure7.svg and figure7.png.
#
# figure7_agents.csv: 1 agents, 2 agent, 5 busy time of the agent in ms
# figure7_speedup.csv: 1 agents, 2 isovalue, 6 speed-up of the agents, 7 of the whole frame

set datafile separator comma

# The numbers of agents above 1, ' 2 4 8', the largest of all, and the isovalue.
counts = ''
most = 1
isovalue = 0
note(n, level) = (counts = n > 1 ? counts.sprintf(' %d', n) : counts, \
                  most = n > most ? n : most, isovalue = level, n)
stats 'figure7_speedup.csv' skip 1 using (note($1, $2)) nooutput

do for [format in 'svg png'] {
  if (format eq 'svg') {
    set terminal svg size 1100,440 background 'white'
  } else {
    set terminal pngcairo size 1100,440
  }
  set output 'figure7.'.format
  set multiplot layout 1,words(counts) > 0 ? 2 : 1 \
    title sprintf('Figure 7: isovalue %g, agents measured one at a time', isovalue)
  if (words(counts) > 0) {
    set key top right
    set yrange [0:*]
    set xrange [0:most + 1]
    set xlabel 'agent'
    set title '(a) busy time of each agent, ms'
    plot for [count in counts] 'figure7_agents.csv' skip 1 \
      using ($1 == count + 0 ? $2 + 1 : NaN):5 with linespoints title count.' agents'
  }
  set key top left
  set yrange [0:most + 1]
  set xrange [0:most + 1]
  set xlabel 'agents'
  set title '(b) speed-up'
  plot x with lines dashtype 2 linecolor 'grey50' title 'ideal', \
    'figure7_speedup.csv' skip 1 using 1:6 with linespoints title 'agents', \
    'figure7_speedup.csv' skip 1 using 1:7 with linespoints title 'whole frame'
  unset multiplot
  unset output
}
