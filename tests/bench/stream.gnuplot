# What a walking client gets and how far its view is off, over time:
#     bench_stream --csv stream.csv ... && gnuplot -e "csv='stream.csv'; svg='stream.svg'" tests/bench/stream.gnuplot
# A line for each of bench_stream's --links.
set terminal svg size 900,560 font 'sans,13' background 'white'
set output svg
set datafile separator ','
links = system("tail -n +2 '".csv."' | cut -d, -f1 | uniq")
name(link) = link eq '0' ? 'no limit' : link.' Mbit/s'
set multiplot layout 2,1
set grid
set key top right
set xlabel 's of the scene'
set ylabel 'Mbit/s'
set yrange [0:*]
plot for [link in links] csv using (stringcolumn(1) eq link ? column(2) : 1/0):3 with lines linewidth 2 title name(link)
set ylabel 'root of relMSE'
set logscale y
set yrange [*:*]
plot for [link in links] csv using (stringcolumn(1) eq link ? column(2) : 1/0):4 with lines linewidth 2 title name(link)
unset multiplot
