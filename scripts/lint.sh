#!/bin/bash
# What compilers do not check: the arrows between folders, circles, unique stems, what documents name, and (--format) the layout
# of the code. "lint.sh prose" alone counts lines of prose with a pattern that is hard to read, by file and by pattern,
# "lint.sh prose --list [FILE...]" prints these lines, "lint.sh prose --draw SEED [FILE...]" twenty sentences at random.
set -euo pipefail
cd "$(dirname "$0")/.."

# Lines of prose that may have such a pattern (scripts/prose.pl). The number may fall; it does not rise.
prose_limit=18

# prose_of OPTIONS FILE...: comments and documents but reports that a program has written; no FILE: all
prose_of() {
    local options=()
    while [[ "${1:-}" = --* ]]; do
        options+=("$1")
        shift
        if [[ "${options[-1]}" = --limit || "${options[-1]}" = --draw ]]; then options+=("$1") && shift; fi
    done
    if [ $# = 0 ]; then mapfile -t files < <(git ls-files '*.c' '*.h' '*.md' | grep -v '^docs/lab/crossover/'); else files=("$@"); fi
    scripts/prose.pl "${options[@]}" docs/architecture.md "${files[@]}"
}
if [ "${1:-}" = prose ]; then
    shift
    if [ $# = 0 ]; then prose_of --limit $prose_limit; else prose_of "$@"; fi
    exit
fi

failed=0
rooms=$(mktemp)
trap 'rm -f "$rooms"' EXIT

complain() {
    echo "lint: $1" >&2
    failed=1
}

# forbid FOLDER PATTERN WHY: no file below FOLDER includes a path that matches PATTERN
forbid() {
    local hits
    hits=$(grep -rnE --include='*.[ch]' "^ *# *include +[\"<]($2)" "$1" || true)
    if [ -n "$hits" ]; then complain "$3:"$'\n'"$hits"; fi
}

forbid common '(proto|server|client|relay)/' 'common knows nobody'
forbid common/base 'common/(builtin|image|light|lightmap|nats|open|scene|shading|tile|tls|trace)/' 'the base knows no other room'
forbid common/scene 'common/(lightmap|builtin|open)/' 'the scene knows neither lightmaps nor builtin scenes'
forbid proto '(server|client|relay)/' 'proto knows common alone'
forbid server '(client|lightwell|relay)/' 'the server does not know the client'
forbid client '(server|relay)/' 'the client does not know the server'
forbid relay '(server/(solve|import|bake)|server/publish/(levels|light_store|publisher|saved_light)|client/(camera|paths|view|measure|load|control|gl))/?' 'a relay serves and is a client: it neither solves nor draws'
# Rooms of the client: camera <- paths <- view, lib <- view <- sides <- figures <- measure; lib <- load, lib <- control.
forbid client/lib 'client/(camera|paths|view|measure|load|control)/' 'the client library draws and measures nothing'
forbid client/camera 'client/(lib|paths|view|gl|measure|load|control)/' 'a camera draws nothing'
forbid client/paths 'client/(lib|view|gl|measure|load|control)/' 'paths know no cache'
forbid client/view 'client/(measure|load|control)/' 'the viewer measures nothing'
# Rooms of the viewer: shading <- lights <- compose <- view <- { window, client/gl }.
own='client/view/[a-z_]+\.h'
forbid client/view/shading "client/(lib|gl|view/(lights|compose|window))/|$own" 'shading knows no client'
forbid client/view/lights "client/(gl|view/(compose|window))/|$own" 'lights know no picture'
forbid client/view/compose "client/(gl|view/window)/|$own" 'the composer knows no window'
forbid client/measure 'client/(load|control)/' 'measuring knows no other command'
forbid client/measure/sides 'client/measure/([a-z_]+\.h|figures/)' 'sides judge nothing'
forbid client/measure/figures 'client/measure/[a-z_]+\.h' 'figures know no command'
forbid client/load 'client/(camera|paths|view|measure|control)/' 'the load test draws nothing'
forbid client/control 'client/(camera|paths|view|measure|load)/' 'control draws and measures nothing'
forbid server/solve 'server/(publish|serve)/|proto/|uv' 'solve knows no network'
# Rooms of the solver: surface <- state <- transport <- { adapt, radiosity } <- frame, state <- filter <- frame.
own='server/solve/[a-z_]+\.h'
forbid server/solve/surface "server/solve/(state|transport|adapt|filter)/|$own" 'surface knows no light'
forbid server/solve/state "server/solve/(transport|adapt|filter)/|$own" 'state knows no rays'
forbid server/solve/transport "server/solve/(adapt|filter)/|$own" 'transport does not know what follows from it'
forbid server/solve/adapt "server/solve/filter/|$own" 'adapt does not know the frame'
forbid server/solve/radiosity "server/solve/(adapt|filter)/|$own" 'radiosity knows transport alone'
forbid server/solve/filter "server/solve/(transport|adapt)/|$own" 'filters know sums alone'
forbid server/publish 'server/serve/' 'publish knows no sessions'
forbid server/serve '(embree|common/trace/)' 'serve traces no rays'
# Rooms of importing: import <- { images, mesh } <- gltf, { import, mesh } <- text <- foreign.
forbid server/import/images 'server/import/(mesh|text|gltf|foreign)/' 'pictures know no format of scenes'
forbid server/import/mesh 'server/import/(images|text|gltf|foreign)/' 'meshes know no format'
forbid server/import/text 'server/import/(images|gltf|foreign)/|assimp/' \
    'text knows neither pictures nor Assimp'
forbid server/import/gltf 'server/import/(text|foreign)/|assimp/' 'glTF has a reader of its own'
forbid server/import/foreign 'server/import/gltf/' 'Assimp reads no glTF'
# Rooms of serving: { admission, metrics, tiles } <- sessions <- transports <- web <- the server.
own='server/serve/[a-z_]+\.h'
for room in admission metrics tiles; do
    forbid server/serve/$room "server/serve/(sessions|transports|web)/|$own" "$room knows no sessions"
done
forbid server/serve/sessions "server/serve/(transports|web)/|$own" 'a session does not know its link'
forbid server/serve/transports "server/serve/web/|$own" 'transports know no HTTP server'
forbid server/serve/web "$own" 'web does not know the server'
for folder in common proto client relay tests server/{solve,publish,serve,bake,nats}; do
    forbid "$folder" 'assimp/' 'only server/import/foreign uses Assimp'
done
forbid client/gl '(SDL|client/view/(window/|headless|path_command))' 'the GL renderer knows no window'
for folder in common/image common/light common/scene common/tile proto server client relay tests; do forbid "$folder" 'embree' 'only common/trace uses Embree'; done

found=$(grep -rnE '"[^"]*\(default:? (-?[0-9.]+|inf|on|off)[;)]' --include='*.[ch]' common server client relay | grep -v 'LW_OPTION_FLAG\|keeps each object' || true)
if [ -n "$found" ]; then complain "a default is stated by the option's value: write {} in its help (options_value.h):"$'\n'"$found"; fi

twins=$(find common proto server client relay -name '*.c' -printf '%f\n' | sort | uniq -d)
if [ -n "$twins" ]; then complain "a stem is the prefix of its functions, so it is unique; twice there is: $twins"; fi

# No circles. Headers: A includes B includes A. Rooms: what their files include, and what their libraries are linked with. A
# room is the library or program whose SOURCES in CMakeLists.txt name the file; a header without a .c belongs to the first one.
circle() { tsort 2>&1 >/dev/null | sed -n 's/^tsort: \([^-]\)/    \1/p'; } # of pairs "from to"; nothing where there is none
inclusions() { git ls-files {common,proto,server,client,relay}/"$1" | xargs grep -oP '^ *# *include +"\K[^"]+' | tr ':' ' '; }
found=$(inclusions '*.h' | circle || true)
if [ -n "$found" ]; then complain "headers include each other:"$'\n'"$found"; fi
git ls-files {common,proto,server,client,relay}/'*CMakeLists.txt' | xargs awk '
    FNR == 1 { folder = FILENAME; sub("/[^/]*$", "", folder) }
    { sub(/#.*/, ""); gsub(/[()]/, " & ") }
    {
        for (i = 1; i <= NF; i++)
            if ($i ~ /^lw_(library|program)$/) { name = ""; reading = 1 }
            else if ($i == ")") reading = 0
            else if (!reading || $i == "(") continue
            else if (name == "") { name = $i; kind = ""; if (!(folder in first)) first[folder] = name; print "first", folder, name }
            else if ($i ~ /^(SOURCES|PUBLIC|PRIVATE|LIBS|COMMANDS)$/) kind = $i
            else if (kind == "SOURCES") { stem = $i; sub(/\.c$/, "", stem); print "file", folder "/" stem, name }
            else if (kind != "COMMANDS") print "link", name, $i
    }' >"$rooms"
found=$(inclusions '*.[ch]' | awk '
    function room_of(path) {
        sub(/\.[ch]$/, "", path)
        if (path in room) return room[path]
        sub("/[^/]*$", "", path)
        return path in first ? first[path] : path
    }
    $1 == "first" { if (!($2 in first)) first[$2] = $3; next }
    $1 == "file" { room[$2] = $3; next }
    $1 == "link" { print $2, $3; next }
    { from = room_of($1); to = room_of($2); if (from != to) print from, to }' "$rooms" - | circle || true)
if [ -n "$found" ]; then complain "rooms need each other:"$'\n'"$found"; fi

# Modules, a .c and the .h of its stem: A includes B includes A. A module that several files implement may be included by its
# parts, for its types. These are "part whole":
parts='client/lib/draws client/lib/client
client/lib/live_tiles client/lib/live
client/lib/replica client/lib/client
client/view/compose/compose_private client/view/compose/compose
client/view/lights/direct_private client/view/lights/direct_pixels
client/view/lights/direct_private client/view/lights/direct_tile
client/view/window/window_private client/view/window/window
common/light/light_kernels common/light/lights
common/lightmap/lightmap_check common/lightmap/lightmap
common/lightmap/lightmap_merge common/lightmap/lightmap_chart
common/lightmap/lightmap_pack common/lightmap/lightmap
common/lightmap/lightmap_shape common/lightmap/lightmap
common/lightmap/lightmap_split common/lightmap/lightmap_chart
common/base/options_manual common/base/options
common/base/options_range common/base/options
common/base/options_value common/base/options
server/import/foreign/foreign_import server/import/foreign/foreign
server/import/gltf/gltf_meshopt server/import/gltf/gltf_document
server/serve/server_private server/serve/server
server/serve/sessions/session_private server/serve/sessions/session
server/serve/sessions/turns server/serve/sessions/session'
found=$(inclusions '*.[ch]' | sed 's/\.[ch]\b//g' | awk '$1 != $2' | grep -vxF "$parts" | circle || true)
if [ -n "$found" ]; then complain "modules include each other; a part that needs its whole is listed in scripts/lint.sh:"$'\n'"$found"; fi

# Calls: a function of A.c calls one of B.c, and B.c calls back.
found=$(git ls-files {common,proto,server,client,relay}/'*.c' | xargs scripts/calls.pl | circle || true)
if [ -n "$found" ]; then complain "files call each other; move a function down, or hand over a callback:"$'\n'"$found"; fi

# A folder with more modules than a reader takes in at a glance holds more than one trade.
modules_max=25
crowded=$(git ls-files {common,proto,server,client,relay}/'*.c' | while read -r file; do
    if [ -e "${file%.c}.h" ]; then dirname "$file"; fi
done | sort | uniq -c | awk -v most=$modules_max '$1 > most { print "    " $2 ": " $1 }')
if [ -n "$crowded" ]; then complain "folders with over $modules_max modules want rooms:"$'\n'"$crowded"; fi

# The first line of a header names the header.
found=$(git ls-files '*.h' | while read -r header; do
    head -1 "$header" | grep -qE "^/\*\*?( @file)? ${header##*/}\b" || echo "    $header"
done)
if [ -n "$found" ]; then complain "headers whose first line is not \"/* NAME.h: what it is for\":"$'\n'"$found"; fi

# Comments have nouns in place of some phrases, as documents have.
found=$(git ls-files '*.c' '*.h' '*.cpp' '*.ts' |
    xargs grep -niE "(^|[^a-z_])(anew|whoever|so many|what is looked at|by turns|of now)([^a-z_]|\$)" || true)
if [ -n "$found" ]; then complain "see CONTRIBUTING.md, Words:"$'\n'"$found"; fi

# Names say what they do: no static is called by one of these words alone, and no identifier has one of the others as a part
# (docs/architecture.md, Words that are out). Comments and strings are no identifiers.
found=$(git ls-files '*.c' '*.h' | xargs perl -0 -ne '
    s{(/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*")}{ $1 =~ tr/\n//cdr }gse;
    for my $out (qr/^(?:LW_[A-Z_]+ )?static [^=;(]*\b(show|place|take|finish|look|settle|pass_on|arrive|recall)\(/m,
        qr/\b(\w*(?<![a-z])(?:told|witness(?:es)?|recall|recoder|forgetful|burial|woken|swarm|contender|urgency)(?![a-z])\w*)/) {
        print "    $ARGV:", 1 + substr($_, 0, $-[1]) =~ tr/\n//, ": $1\n" while /$out/g;
    }' | sort -u)
if [ -n "$found" ]; then complain "names that are out:"$'\n'"$found"; fi

# Lines of code have at most 110 columns. Bytes that continue a character of UTF-8 are no columns.
wide=$(git ls-files '*.c' '*.h' | LC_ALL=C xargs awk '
    { line = $0; gsub(/[\200-\277]/, "", line) }
    length(line) > 110 { print FILENAME ":" FNR ": " length(line) " columns" }')
if [ -n "$wide" ]; then complain "lines over 110 columns:"$'\n'"$(sed 30q <<<"$wide")"; fi

# Sentence patterns: CONTRIBUTING.md, Words.
scripts/prose.pl --self-test docs/architecture.md || complain 'scripts/prose.pl fails its own test'
found=$(prose_of --limit $prose_limit 2>&1 >/dev/null) || complain "$found; \"scripts/lint.sh prose --list FILE\" has them"

# Documents: lines of at most 110 columns, paragraphs of at most 120 words, nouns in place of some phrases. Tables, links and
# commands may be wider, and reports that a program has written.
check_prose() {
    LC_ALL=C awk '
        function paragraph() {
            if (words > 120) print FILENAME ":" first ": a paragraph of " words " words, over 120"
            gsub(/`[^`]*`/, "", text)
            if (match(text, /[^a-z](anew|whoever|so many|what is looked at|by turns|of now)[^a-z]/))
                print FILENAME ":" first ": \"" substr(text, RSTART + 1, RLENGTH - 2) "\": see CONTRIBUTING.md, Words"
            words = 0
            text = " "
        }
        BEGIN { text = " " }
        /^```/ { fence = !fence; paragraph(); next }
        fence || /^$/ || (/^(    |\t)/ && !words) { paragraph(); next }
        /^ *([*+-]|[0-9]+\.) / || /^#/ { paragraph() }
        text == " " { first = FNR }
        { text = text tolower($0) " " }
        /^ *\|/ { paragraph(); next }
        {
            words += NF
            gsub(/[\200-\277]/, "")
            if (length($0) > 110 && NF > 2) print FILENAME ":" FNR ": " length($0) " columns, over 110"
        }
        END { paragraph() }' "$1"
}
prose=$(git ls-files '*.md' | grep -v '^docs/lab/crossover/' | while read -r document; do check_prose "$document"; done)
if [ -n "$prose" ]; then complain "documents:"$'\n'"$prose"; fi

# Documents have at most 250 lines, so that one answers one question: what was measured has docs/lab, and a format is whole.
long=$(git ls-files '*.md' | grep -vE '^(docs/lab/.*|CHANGELOG\.md|docs/scene_package\.md|proto/wire_format\.md)$' |
    xargs wc -l | awk '$1 > 250 && $2 != "total" { print "    " $2 ": " $1 " lines, over 250" }')
if [ -n "$long" ]; then complain "documents that are too long:"$'\n'"$long"; fi

# One index of what was measured, and at most forty words to learn.
for document in docs/lab/*.md; do
    name=${document##*/}
    [ "$name" = README.md ] || grep -qF "($name" docs/lab/README.md || complain "docs/lab/README.md does not list $name"
done
words=$(sed -n '/^## Words$/,/^## /p' docs/architecture.md | grep -c '^| [^|-]' || true)
if [ "$words" -gt 41 ]; then complain "docs/architecture.md explains $((words - 1)) words, over 40"; fi

long=$(awk '/^## / { if (name != "" && lines > 40) print "    " name ": " lines " lines, over 40"; name = $0; lines = 0 }
    { lines++ } END { if (name != "" && lines > 40) print "    " name ": " lines " lines, over 40" }' CHANGELOG.md)
if [ -n "$long" ]; then complain "CHANGELOG.md tells effects on users in 40 lines a release:"$'\n'"$long"; fi

# Documents: links lead somewhere, `folder/file` is there (its ending may be left out), options exist.
# headings FILE: as links name them
headings() { sed -n 's/^##* //p' "$1" | tr 'A-Z ' 'a-z-' | tr -cd 'a-z0-9_\n-'; }
while read -r document; do
    while read -r link; do
        [ -e "$(dirname "$document")/$link" ] || complain "$document: a link to $link, which is not there"
    done < <(grep -oP '\]\(\K[^)#: ]+(?=[)#])' "$document")
    while IFS='#' read -r link heading; do
        file=$document
        [ -z "$link" ] || file=$(dirname "$document")/$link
        [ ! -f "$file" ] || grep -qx -- "$heading" < <(headings "$file") ||
            complain "$document: a link to $link#$heading, a heading that is not there"
    done < <(grep -oP '\]\(\K[^): ]*\.?[^): ]*#[^): ]+(?=\))' "$document")
    while read -r path; do
        compgen -G "$path" >/dev/null || compgen -G "$path.*" >/dev/null ||
            complain "$document: names $path, which is not there"
    done < <(grep -oP '`\K(common|proto|server|client|tests|docs|scripts|cmake)/[\w./*-]+(?=`)' "$document")
done < <(git ls-files '*.md')

# Figures that stand in two documents have a mark right behind them, 0.25<!-- r1 atrium-lamp-walk-720 -->. One mark has one
# value, in two documents or more. "r1 ROW", "m ROW" and "p ROW", with " svgf" for that opponent in place of svgf-quarter, are
# roundings of the report in docs/lab/crossover/ROW, by relMSE; p is the opponent's CPU s a frame.
found=$(git ls-files '*.md' | grep -v '^docs/lab/crossover/' | xargs grep -HnoP '(\d[\d.,]*)?\**<!-- [a-z0-9][a-z0-9. -]* -->' |
    awk -F: '
    function measured(kind, row, opponent,   path, line, part, number) {
        path = "docs/lab/crossover/" row "/report.md"
        while ((getline line < path) > 0) {
            split(line, part, / *\| */)
            if (part[2] ~ "^" opponent "," && part[4] == "relMSE") {
                number = part[kind == "r1" ? 8 : kind == "m" ? 9 : 3]
                break
            }
        }
        close(path)
        sub(/ .*/, "", number)
        return number
    }
    {
        at = $1 ":" $2
        value = name = $3
        sub(/\**<!-- .*/, "", value)
        gsub(/.*<!-- | -->/, "", name)
        if (value == "") print at ": no figure before the mark \"" name "\""
        if (!(name in first)) { first[name] = value; place[name] = at; document[name] = $1 }
        if (value != first[name]) print at ": " value " for \"" name "\", and " first[name] " at " place[name]
        if ($1 != document[name]) shared[name] = 1
        if (split(name, word, " ") < 2 || word[1] !~ /^(r1|m|p)$/) next
        number = measured(word[1], word[2], word[3] == "" ? "svgf-quarter" : word[3])
        decimals = length(value) - index(value ".", ".")
        off = value - number
        if (number !~ /^[0-9]/ || (off < 0 ? -off : off) > 0.5 / 10 ^ (decimals < 0 ? 0 : decimals) + 1e-9)
            print at ": " value " for \"" name "\", of which the report has " (number == "" ? "nothing" : number)
    }
    END { for (name in first) if (!(name in shared)) print place[name] ": \"" name "\" stands in one document alone" }' || true)
if [ -n "$found" ]; then complain "figures:"$'\n'"$found"; fi

# The Dockerfile, by an npm package, where scripts/deps.sh has fetched it. A warning counts, too.
docker_lint=client/web/node_modules/dockerfile-utils/bin/dockerfile-utils
if command -v node >/dev/null && [ -e $docker_lint ]; then
    found=$(node $docker_lint lint docker/Dockerfile 2>&1 || true)
    if [ -n "$found" ]; then complain "docker/Dockerfile:"$'\n'"$found"; fi
else
    echo "lint: docker/Dockerfile is not looked at: there is no dockerfile-utils (scripts/deps.sh)" >&2
fi

# What the Debian packages are built from is what scripts/deps.sh installs; the library's symbols are those of its header.
unknown=$(sed -n '/^Build-Depends:/,/^Standards/p' debian/control | grep -oP '^ \K[a-z0-9.+-]+' | grep -vx debhelper-compat |
    while read -r package; do grep -qE "(^|[ (])$package([ )]|\$)" scripts/deps.sh || echo "$package"; done)
if [ -n "$unknown" ]; then complain "debian/control: scripts/deps.sh does not install ${unknown//$'\n'/, }"; fi
symbols=$(diff <(grep -oP '^ \Klw_live_[a-z0-9_]+(?=@Base)' debian/liblightwell1.symbols | sort) \
    <(tr '\n' ' ' <client/include/lightwell/lightwell.h | grep -oP 'LW_LIVE_API[^(;]*?\b\Klw_live_[a-z0-9_]+(?= *\()' |
        sort -u) || true)
if [ -n "$symbols" ]; then complain "debian/liblightwell1.symbols (<) and lightwell.h (>) differ:"$'\n'"$symbols"; fi

bin=build/release/bin
programs='lightwelld lightwell-relay lightwellctl lightwell-view lightwell-bake lightwell-import lightwell-load'
missing=$(for program in $programs; do [ -x $bin/$program ] || echo $program; done)
if [ -z "$missing" ]; then
    options=$({
        for program in $programs 'lightwell-load scaling' 'lightwell-load crossover'; do $bin/$program --help; done
        sed -n '/^#/p' scripts/crossover.sh
    } | grep -oP -- '--[a-z][a-z-]*' | sort -u)
    for document in README.md docs/{architecture,solve,solve_levels,solvers,change,serving,scaling,composing,limitations,running,access,changing,measuring,viewing,baking,importing,importing_gltf,importing_finish,importing_other,planning,units}.md; do
        unknown=$(sed 's/systemctl .*//; s/dpkg-buildpackage .*//; s/`systemd-analyze [^`]*`//' $document | grep -oP -- '(?<![\w-])--[a-z][a-z-]*' |
            sort -u | comm -23 - <(echo "$options") || true)
        if [ -n "$unknown" ]; then complain "$document: no program has ${unknown//$'\n'/, }"; fi
    done
else
    echo "lint: options in documents are compared with the programs' once $bin has" $missing >&2
fi

if [ "${1:-}" = --format ]; then
    git ls-files '*.c' '*.h' | xargs clang-format --dry-run -Werror || failed=1
fi
exit $failed
