#!/usr/bin/perl
# Counts lines of prose, comments of .c and .h and Markdown, that have a sentence pattern which is hard to read.
#   prose.pl [--list] [--limit N] WORDS FILE...   counts by pattern and by file; --list: each line; over N lines: exit code 1
#   prose.pl --draw SEED WORDS FILE...            prints twenty sentences of six words or more at random, to be judged by a reader
#   prose.pl --self-test WORDS                    checks each pattern against its own sentences, bad and good
# WORDS is the document with the table of words that are out: its heading is "Words that are out", a row's first cell has
# the words in backticks, each a regular expression.
use strict;
use warnings;

my $verb = qr/(?:is|are|was|were|has|have|had|may|can|must|will|would|does|do|did|could|should)/;
my $participle = qr/(?:\w+(?:ed|en|ught|ept|elt|ent|ade)|been|gone|done|come|become|lost|found|told|held|begun|run|read|put|set)/;

# NAME, PATTERN, a sentence that has it, one that does not. ^ is the start of a sentence: of a comment, a cell, a paragraph,
# or behind a full stop. A comment may start with a small letter, a sentence behind a full stop does not.
my @patterns = (
    ['headless', qr/^(?:of|that(?! is (?:why|how))|those|likewise|whose)\b(?! (?:course|all)\b)/i,
        'Of the squares, the share that is uncertain', 'The share of the squares that is uncertain'],
    ['clause', qr/(?:\bwhat|\bwhatever|\bwhoever|(?:^|[,;:(] ?|\b(?:of|to|for|by|with|and|or|than|as|at|that|not|but|from) )who|\b(?:of|to|from|than|at|on|in|for) where) (?:$verb\b(?! (?:a|an|the|it|they|he|she)\b)|comes?\b|goes\b|light is\b|changes\b|moves\b)(?![^.]*\?)/i,
        'The size of what is shown', 'It says what a frame costs, and who pays.'],
    # three facts, of two words and more each: figures of a table are none
    ['semicolons', qr/^(?!errors:|after:)(?:[^;]*\b[[:alpha:]]{2,}\b[^;]+\b[[:alpha:]]{2,}\b[^;]*;){2}[^;]*\b[[:alpha:]]{2,}\b[^;]+\b[[:alpha:]]{2,}\b/i,
        'Its place; 0 if it is due; none else', 'Its place; 0.5 m; 0.7 m'],
    ['past perfect', qr/\bhad (?:not )?$participle\b|\b(?:must|may|can|could|would|should|will|might) have been\b|\b(?:have|has) been(?=[.,;]|$)/i,
        'They show after those have been.', 'They had a list of frames, and it has been sent.'],
    ['pronoun', qr/(?<!so )\bthat one\b(?=[.,;:)]| (?:is|are|was|has|does|and|or|alone|which|who)\b|$)|\bthe (?:latter|former)\b(?! \w)|\bthe other(?=[.,;:)]|$)|^(?:those|these) $verb\b|(?!^)\bthose(?=[.,;:)]| $verb\b|$)/i,
        'It follows that one.', 'It follows the other tile, and those of the room.'],
);

my $self_test = @ARGV && $ARGV[0] eq '--self-test' && shift;
my $list = @ARGV && $ARGV[0] eq '--list' && shift;
my $seed = @ARGV && $ARGV[0] eq '--draw' && do { shift; shift };
my $limit;
if (@ARGV && $ARGV[0] eq '--limit') { shift; $limit = shift; }
my $words = shift or die "prose.pl [--list] [--limit N] WORDS FILE...\n";
push @patterns, ['word', read_words($words)];

sub slurp {
    my ($path) = @_;
    open my $file, '<', $path or die "prose: $path: $!\n";
    local $/;
    return <$file>;
}

# The words of the first cells of the table below "Words that are out", as one pattern.
sub read_words {
    my ($text) = slurp($_[0]) =~ /^#+ Words that are out\n(.*?)(?=^#|\z)/ms or die "prose: $_[0] has no \"Words that are out\"\n";
    my @out;
    for my $cell ($text =~ /^\|(.*?[^\\])\|/mg) { push @out, $cell =~ /`([^`]+)`/g; }
    die "prose: $_[0] lists no words\n" unless @out;
    s/\\\|/|/g for @out;
    my $any = join '|', @out;
    return qr/(?<![\w-])(?:$any)(?![\w-])/i;
}

# found(TEXT): [pattern, offset] of each, by sentence. Names in backticks are no prose.
sub found {
    my ($text) = @_;
    my (@hits, $later);
    while ($text =~ /\G\s*(.+?(?:[.!?](?=\s|$)|$))/gs) {
        my ($sentence, $at) = ($1, $-[1]);
        $sentence =~ s/\s/ /g;
        for (@patterns) {
            my ($name, $pattern) = @$_;
            # behind "e.g." and such; "That takes 5 s" follows a sentence; a question
            next if $name eq 'headless' && ($sentence =~ /\?$/ || ($later && $sentence =~ /^(?:[a-z]|That\b)/));
            next unless $sentence =~ $pattern;
            my $where = $-[0];
            next if $name eq 'word' && $& eq uc $&; # a message: SETTLED
            push @hits, [$name, $at + $where];
        }
        $later = 1;
    }
    return @hits;
}

if ($self_test) {
    my $failed = 0;
    for (@patterns) {
        my ($name, $pattern, $bad, $good) = @$_;
        next unless defined $bad;
        for ([$bad, 1], [$good, 0]) {
            my ($sentence, $wanted) = @$_;
            my $has = grep { $_->[0] eq $name } found($sentence);
            next if !!$has == !!$wanted;
            print STDERR "prose: \"$name\" ", $wanted ? 'misses' : 'takes', ": $sentence\n";
            $failed = 1;
        }
    }
    # comments and paragraphs are found, at their lines; code, strings and names in backticks are none
    my $code = "int a; /* a sum */\nconst char *b = \"/* of x */\";\n/* A sum.\n * Of the squares\n */\nint what(is); // of b\n";
    my @lines = map { $_->[1] } hits_of(\&comments_of, $code);
    if ("@lines" ne '4 6') { print STDERR "prose: comments at lines @lines, not at 4 and 6\n"; $failed = 1; }
    my $document = "# Title\n\nA sum of `what is`.\nOf the squares\n\n    of code\n\n```\nof code\n```\n| a | of b |\n* of c\n";
    @lines = map { $_->[1] } hits_of(\&paragraphs_of, $document);
    if ("@lines" ne '4 11 12') { print STDERR "prose: paragraphs at lines @lines, not at 4, 11 and 12\n"; $failed = 1; }
    exit $failed;
}

# Both call FOUND(text, offset in the file) for each text. Offsets stay: what is no prose becomes blanks.
sub comments_of {
    my ($code, $take) = @_;
    while ($code =~ m{"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*'|(/\*.*?\*/)|(//[^\n]*(?:\n[ \t]*//[^\n]*)*)}gs) {
        my ($text, $at) = defined $1 ? ($1, $-[1]) : defined $2 ? ($2, $-[2]) : next;
        $text =~ s{^/\*\*?<?}{' ' x length $&}e;
        $text =~ s{\*/$}{  };
        $text =~ s{^([ \t]*)(\*|//)}{$1 . ' ' x length $2}gme;
        # a parameter, a field of a header or a blank line begins a text
        my $from = 0;
        for my $part (split /(\n[ \t]*(?=\n)|\n(?=[ ]*\w+(?:, \w+)*(?:  |:  )))/, $text) { $take->($part, $at + $from); $from += length $part; }
    }
}

sub paragraphs_of {
    my ($text, $take) = @_;
    my ($fence, $paragraph, $begin, $at) = (0, '', 0, 0);
    my $flush = sub { $take->($paragraph, $begin) if $paragraph =~ /\S/; $paragraph = ''; };
    for my $line ($text =~ /[^\n]*\n|[^\n]+$/g) {
        my $prose = $line;
        $prose =~ s/`[^`\n]*`/'X' x length $&/ge;
        $prose =~ s/\]\([^)\n]*\)/' ' x length $&/ge;
        $prose =~ s/<!--.*?-->/' ' x length $&/ge;
        $prose =~ s/[*_\[\]]/ /g if $prose !~ /^ *[*+-] /;
        if ($line =~ /^```/) { $flush->(); $fence = !$fence; }
        elsif ($fence || $line =~ /^\s*$/ || ($line =~ /^(?:    |\t)/ && $paragraph eq '')) { $flush->(); }
        elsif ($line =~ /^#/) { $flush->(); }
        elsif ($line =~ /^ *\|/) {
            $flush->();
            my $cell_at = $at;
            for my $cell (split /(?<!\\)(\|)/, $prose) { $take->($cell, $cell_at) if $cell =~ /\w/; $cell_at += length $cell; }
        }
        else {
            if ($prose =~ s/^( *)([*+-]|\d+\.) /$1 . ' ' x (1 + length $2)/e) { $flush->(); $prose =~ s/[*_\[\]]/ /g; }
            $begin = $at if $paragraph eq '';
            $paragraph .= $prose;
        }
        $at += length $line;
    }
    $flush->();
}

# [pattern, line] of each
sub hits_of {
    my ($texts_of, $content) = @_;
    my @hits;
    $texts_of->($content, sub {
        my ($text, $at) = @_;
        push @hits, [$_->[0], 1 + (substr($content, 0, $at + $_->[1]) =~ tr/\n//)] for found($text);
    });
    return @hits;
}

if ($seed) {
    my @drawn;
    for my $path (@ARGV) {
        my $content = slurp($path);
        ($path =~ /\.md$/ ? \&paragraphs_of : \&comments_of)->($content, sub {
            my ($text, $at) = @_;
            while ($text =~ /\G\s*(.+?(?:[.!?](?=\s|$)|$))/gs) {
                my ($sentence, $from) = ($1, $at + $-[1]);
                $sentence =~ s/\s+/ /g;
                next if (() = $sentence =~ /\b[[:alpha:]]{2,}\b/g) < 6 || $sentence =~ /^clang-format/;
                push @drawn, "$path:" . (1 + (substr($content, 0, $from) =~ tr/\n//)) . ": $sentence\n";
            }
        });
    }
    srand $seed;
    print splice @drawn, rand @drawn, 1 for 1 .. 20;
    exit;
}

my (%by_pattern, %by_file, $total);
for my $path (@ARGV) {
    my $content = slurp($path);
    my %lines;
    for (hits_of($path =~ /\.md$/ ? \&paragraphs_of : \&comments_of, $content)) { $lines{$_->[1]}{$_->[0]} = 1; }
    my @text = $list ? split(/\n/, $content) : ();
    for my $line (sort { $a <=> $b } keys %lines) {
        my @names = sort keys %{$lines{$line}};
        $by_pattern{$_}++ for @names;
        $total++;
        print "$path:$line: ", join(', ', @names), ": ", $text[$line - 1] =~ s/^\s+//r, "\n" if $list;
    }
    $by_file{$path} = keys %lines if %lines;
}
$total //= 0;
unless ($list) {
    printf "%6d  %s\n", $by_file{$_}, $_ for sort { $by_file{$b} <=> $by_file{$a} || $a cmp $b } keys %by_file;
    print "\n";
    printf "%6d  %s\n", $by_pattern{$_}, $_ for sort { $by_pattern{$b} <=> $by_pattern{$a} } keys %by_pattern;
}
print "$total lines of prose have a pattern of scripts/prose.pl\n";
if (defined $limit && $total > $limit) {
    print STDERR "prose: $total lines, over the limit of $limit: see CONTRIBUTING.md, Words\n";
    exit 1;
}
