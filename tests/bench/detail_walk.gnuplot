# What a walk takes of a server's memory, and its tiles of finer levels:
#     gnuplot -e "csv='walk.csv'; svg='walk.svg'" tests/bench/detail_walk.gnuplot
set terminal svg size 900,480 font 'sans,13' background 'white'
set output svg
set datafile separator ','
set multiplot layout 2,1
set grid
set xlabel 's'
set yrange [0:*]
set key bottom right
set ylabel 'resident memory, MB'
plot csv every ::1 using ($1 == 0 ? $2 : 1/0):3 with lines linewidth 2 title '--detail 0', \
     csv every ::1 using ($1 == 4 ? $2 : 1/0):3 with lines linewidth 2 title '--detail 4'
set ylabel 'tiles of finer levels'
plot csv every ::1 using ($1 == 4 ? $2 : 1/0):5 with lines linewidth 2 title 'asked for', \
     csv every ::1 using ($1 == 4 ? $2 : 1/0):4 with lines linewidth 2 title 'there'
unset multiplot
