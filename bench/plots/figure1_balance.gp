# Figure 1: the balance over the isovalues, one picture for each number of agents P.
#
# `gnuplot figure1_balance.gp` in the folder of its data writes figure1_pP.svg and figure1_pP.png.
#
# figure1_balance.csv: 1 distribution, 2 agents, 3 agent, 4 isovalue, 5 active blocks, 6 triangles,
# 7 busy time of the agent in ms

data = 'figure1_balance.csv'
set datafile separator comma

# The numbers of agents, each once, in the order of the file: ' 2 4 8'.
counts = ''
note(n) = (counts = strstrt(counts.' ', sprintf(' %d ', n)) ? counts : counts.sprintf(' %d', n), n)
stats data skip 1 using (note($2)) nooutput

array panel_title[3] = ['active blocks', 'triangles', 'busy time of the agent, ms']
set key off
set xlabel 'isovalue'
set yrange [0:*]
do for [count in counts] {
  do for [format in 'svg png'] {
    if (format eq 'svg') {
      set terminal svg size 1260,720 background 'white'
    } else {
      set terminal pngcairo size 1260,720
    }
    set output 'figure1_p'.count.'.'.format
    set multiplot layout 2,3 title 'Figure 1: one curve for each of '.count.' agents'
    do for [wanted in 'greedy random'] {
      do for [panel=1:3] {
        set title wanted.': '.panel_title[panel]
        plot for [agent=0:count - 1] data skip 1 \
          using (strcol(1) eq wanted && $2 == count + 0 && $3 == agent ? $4 : NaN):4 + panel \
          with lines
      }
    }
    unset multiplot
    unset output
  }
}
