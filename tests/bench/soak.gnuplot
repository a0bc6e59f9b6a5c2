# What a server's memory, descriptors and frames did over time:
#     gnuplot -e "csv='soak.csv'; svg='soak.svg'" tests/bench/soak.gnuplot
set terminal svg size 900,720 font 'sans,13' background 'white'
set output svg
set datafile separator ','
set multiplot layout 3,1
set grid
set key off
set xlabel 'minutes'
set yrange [0:*]
set ylabel 'resident memory, MB'
plot csv every ::1 using ($1/60):($2/1024) with lines linewidth 2
set ylabel 'sessions, descriptors'
set key bottom right
plot csv every ::1 using ($1/60):4 with lines linewidth 2 title 'sessions', \
     csv every ::1 using ($1/60):3 with lines linewidth 2 title 'descriptors'
set key off
set ylabel 'longest frame, ms'
plot csv every ::1 using ($1/60):5 with lines linewidth 2
unset multiplot
