#!/usr/bin/perl
# Which .c file needs functions or tables of which other: prints "CALLER CALLEE" pairs, without .c.
#   calls.pl FILE...
# By names: a file defines lw_ names at the start of a line, and needs those that stand anywhere outside comments and strings.
# That is what nm finds in objects, without a build.
use strict;
use warnings;

my (%home, %named);
for my $file (@ARGV) {
    open my $in, '<', $file or die "calls: $file: $!\n";
    my $text = do { local $/; <$in> };
    $text =~ s{/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])'}{}gs;
    my $stem = $file =~ s/\.c$//r;
    $home{$1} = $stem
        while $text =~ /^(?!static\b|extern\b|typedef\b)[A-Za-z][\w \t*]*?\b(lw_\w+)(?:\([^;{}]*\)\s*\{|(?:\[[^]]*\])*\s*=)/mg;
    $named{$stem}{$1} = 1 while $text =~ /(?<!struct )(?<!enum )\b(lw_\w+)/g;
}
for my $stem (sort keys %named) {
    my %to = map { $_ => 1 } grep { defined && $_ ne $stem } map { $home{$_} } keys %{ $named{$stem} };
    print "$stem $_\n" for sort keys %to;
}
