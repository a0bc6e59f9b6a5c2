# Age of light and bytes of users of three relays, while parts are killed:
#     gnuplot -e "folder='kills'; users=50" tests/bench/kills.gnuplot
set terminal svg size 1000,700 font 'sans,13' background 'white'
set output folder.'/kills.svg'
set datafile separator ','
events = folder.'/events.csv'
begin = real(system("head -n 1 '".events."' | cut -d, -f1")) - 5
stats events using 1 nooutput
last = STATS_max - begin + 15
set for [n = 1:3] linetype n linecolor rgb word('#d55e00 #0072b2 #009e73', n) linewidth 2
name(n) = n == 1 ? 'relay 1, from NATS' : n == 2 ? 'relay 2, from NATS' : 'relay 3, from the daemon'
file(n) = folder.'/relay'.n.'.csv'
do for [i = 1:int(STATS_records)] {
    line = system("sed -n ".i."p '".events."'")
    comma = strstrt(line, ',')
    when = real(line[1:comma - 1]) - begin
    what = line[comma + 1:*]
    is_kill = strstrt(what, 'killed') > 0
    set arrow i from when, graph 0 to when, graph 1 nohead linecolor rgb (is_kill ? 0x000000 : 0xa0a0a0)
    if (is_kill) { set label i what at when, graph 1.06 left }
}
set xrange [0:last]
set grid
set lmargin 11
set rmargin 3
set bmargin 2
set multiplot
set size 1, 0.40
set origin 0, 0.60
set tmargin 3
set key off
set ylabel 'oldest light of a user, s'
set logscale y
set yrange [0.01:*]
plot for [n = 1:3] file(n) every ::1 using ($1 - begin):(1e-3 * $5) with lines linetype n
unset for [i = 1:20] label i
unset logscale y
set tmargin 1
set size 1, 0.28
set origin 0, 0.32
set ylabel 'Mbit/s a user'
set yrange [0:*]
second(n) = "< awk -F, -v CONVFMT=%.3f 'NR > 1 { s = int($1); if (s != was && was) print was + 0.5 \",\" sum; if (s != was) sum = 0; was = s; sum += $3 }' '".file(n)."'"
plot for [n = 1:3] second(n) using ($1 - begin):(8e-6 * $2 / users) with lines linetype n
set size 1, 0.32
set origin 0, 0
set bmargin 3
set ylabel 'MB a user, in all'
set key top left reverse Left
set xlabel 's'
sums(n) = "< awk -F, -v CONVFMT=%.3f -v from=".sprintf('%.3f', begin)." 'NR > 1 && $1 >= from { sum += $3; print $1 \",\" sum }' '".file(n)."'"
plot for [n = 1:3] sums(n) using ($1 - begin):(1e-6 * $2 / users) with lines linetype n title name(n)
unset multiplot
