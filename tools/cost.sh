#!/usr/bin/env bash
# Measures anew what docs/accuracy-and-cost.md reports: tools/cost.sh CALOR [NAME...]
#
# CALOR is the program; NAME stands for the scene data/cost/NAME.nml, all of them without it. Each
# scene's table goes between '<!-- cost: NAME -->' and '<!-- end -->', its pictures into
# docs/pictures/cost_NAME.svg and .png. Wall times want a quiet machine: calor says so where it was
# not one.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
readonly calor=$(realpath "$1") document=docs/accuracy-and-cost.md
shift
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

names=("$@")
if [[ ${#names[@]} == 0 ]]; then
  for scene in data/cost/*.nml; do names+=("$(basename "$scene" .nml)"); done
fi

# Prints the table $1 (CSV, without commas in the fields used) as Markdown, times in milliseconds.
table() {
  awk -F, '
    function ms(seconds) { return sprintf(1000*seconds < 10 ? "%.2f" : "%.0f", 1000*seconds) }
    NR == 1 {
      for (i = 1; i <= NF; i++) c[$i] = i
      print "| scheme | h/Δ | Δ, m | neighbours | error | of that by time | steps | evaluations" \
        " | set-up, ms | control, ms | stability, ms | steps, ms | total, ms | memory, MB |"
      print "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"
      next
    }
    {
      name = "`" $c["laplacian"] "`" ($c["order"] == "" ? "" : " " $c["order"])
      line = sprintf("| %s | %s | %.4g | ", name, $c["support"], $c["spacing"])
      if ($c["total_seconds"] == "") {
        reason = $0
        sub(/^[^"]*"/, "", reason); sub(/[,"].*$/, "", reason)
        rows[name $c["support"]] = rows[name $c["support"]] line reason " | | | | | | | | | | |\n"
      } else {
        mark = $c["on_front"] == 1 ? "**" : ""
        rows[name $c["support"]] = rows[name $c["support"]] line sprintf( \
          "%.1f | %s%.1e%s | %.0e | %d | %d | %s | %s | %s | %s | %s%s%s | %.2f |\n", \
          $c["neighbours"], mark, $c["relative_l2_error"], mark, $c["time_error"], $c["steps"], \
          $c["evaluations"], ms($c["cloud_seconds"] + $c["assembly_seconds"]), \
          ms($c["step_control_seconds"]), ms($c["stability_seconds"]), ms($c["steps_seconds"]), \
          mark, ms($c["total_seconds"]), mark, $c["memory_bytes"]/1e6)
      }
      if (!(name $c["support"] in seen)) { seen[name $c["support"]]; order[++methods] = name $c["support"] }
    }
    END { for (i = 1; i <= methods; i++) printf "%s", rows[order[i]] }' "$1"
}

# Prints the scene $1 without its group &cost (the last one), and what else it shall say.
variant() {
  sed '/^&cost/,$d' "$1"
  printf '%s\n' "${@:2}"
}

# Wall time and, if told, estimated and true error of a run, as calor prints them.
figures() {
  awk '/^Wall time/ { wall = $3 } /^Estimate/ { estimate = $5 } /^Error/ { error = $5 }
    END { sub(",", "", estimate); print wall, estimate, error }' "$1"
}

median() { sort -g | awk '{ v[NR] = $1 } END { print v[int((NR + 1)/2)] }'; }

# What the error bar of scene $1 costs and how near it comes, scheme by scheme: runs with and without
# it take turns.
error_bars() {
  printf '\n| scheme | true error | estimated | estimated/true | plain run, ms | with error bar, ms | ratio |\n'
  printf '|---|---|---|---|---|---|---|\n'
  local scheme run kind
  for scheme in "laplacian = 'fatehi_manzari'" "laplacian = 'positive'" \
    "laplacian = 'consistent' order = 4" "laplacian = 'consistent' order = 6"; do
    rm -f "$scratch"/bar.*
    variant "$1" "&scheme $scheme /" >"$scratch/plain.nml"
    variant "$1" "&scheme $scheme /" '&accuracy estimate = .true. /' >"$scratch/bar.nml"
    for run in 1 2 3 4 5; do
      for kind in plain bar; do
        "$calor" run "$scratch/$kind.nml" >"$scratch/out"
        figures "$scratch/out" >>"$scratch/bar.$kind"
      done
    done
    awk -v scheme="$(sed "s/laplacian = '\([a-z_]*\)'/\`\1\`/; s/order = //" <<<"$scheme")" \
      -v plain="$(median <"$scratch/bar.plain")" -v bar="$(median <"$scratch/bar.bar")" '
      NR == 1 { printf "| %s | %.2e | %.2e | %.2f | %.0f | %.0f | %.1f |\n", scheme, $3, $2, $2/$3,
        1000*plain, 1000*bar, bar/plain }' "$scratch/bar.bar"
  done
}

# What reaching a target costs for scene $1, beside the cheapest entry of the table $2 that reaches
# it.
targets() {
  printf '\n| target | chosen | Δ, m | estimated | true error | all runs, ms | cheapest above, ms | ratio |\n'
  printf '|---|---|---|---|---|---|---|---|\n'
  local target run
  for target in 1e-2 1e-3 1e-4 1e-5 1e-6 1e-7; do
    variant "$1" "&accuracy target = $target /" >"$scratch/target.nml"
    : >"$scratch/target.seconds"
    for run in 1 2 3 4 5; do
      "$calor" run "$scratch/target.nml" >"$scratch/out"
      awk '/^  (pilot|run)/ { total += $(NF - 1) } END { print total }' "$scratch/out" \
        >>"$scratch/target.seconds"
    done
    awk -v target="$target" -v all="$(median <"$scratch/target.seconds")" \
      -v figures="$(figures "$scratch/out")" -v best="$(awk -F, -v target="$target" '
        NR == 1 { for (i = 1; i <= NF; i++) c[$i] = i; next }
        $c["total_seconds"] != "" && $c["relative_l2_error"] <= target+0 &&
          (best == "" || $c["total_seconds"] < best) { best = $c["total_seconds"] }
        END { print best }' "$2")" '
      /^  (pilot|run)/ {
        chosen = $0; sub(/^  (pilot|run) */, "", chosen); sub(/,.*/, "", chosen)
        spacing = $0; sub(/ m apart.*/, "", spacing); sub(/.* /, "", spacing)
      }
      END {
        split(figures, f, " ")
        printf "| %s | `%s` | %s | %s | %s | %.0f | %s | %s |\n", target, chosen, spacing, f[2], f[3],
          1000*all, best == "" ? "none" : sprintf("%.0f", 1000*best),
          best == "" ? "" : sprintf("%.1f", all/best)
      }' "$scratch/out"
  done
}

# Prints the document with the section of scene $1 replaced by file $2.
renewed() {
  awk -v begin="<!-- cost: $1 -->" -v section="$2" '
    $0 == begin { print; while ((getline line < section) > 0) print line; inside = 1; found = 1; next }
    $0 == "<!-- end -->" { inside = 0 }
    !inside
    END { exit !found }' "$document"
}

for name in "${names[@]}"; do
  (cd "$scratch" && "$calor" cost "$OLDPWD/data/cost/$name.nml" >"$name.txt")
  {
    printf '\n![Error against wall time](pictures/cost_%s.png)\n\n' "$name"
    # The sentence, and a warning where there is one
    awk '/^(The machine was busy|For an error|Nothing that was)/ { inside = 1 } /^$/ { if (inside) print; inside = 0 } inside' \
      "$scratch/$name.txt"
    table "$scratch/$name.csv"
    if grep -q exact_expression "data/cost/$name.nml"; then
      printf '\n**Error bars**: runs of the scene as it stands, with and without `&accuracy estimate = .true.`.\n'
      error_bars "data/cost/$name.nml"
      printf '\n**Targets**: runs with `&accuracy target`, their search included.\n'
      targets "data/cost/$name.nml" "$scratch/$name.csv"
    fi
    printf '\n'
  } >"$scratch/section"
  if ! renewed "$name" "$scratch/section" >"$scratch/document"; then
    echo "$document has no section '<!-- cost: $name -->'" >&2
    exit 1
  fi
  cp "$scratch/document" "$document"
  for kind in svg png; do cp "$scratch/$name.$kind" "docs/pictures/cost_$name.$kind"; done
  echo "renewed the section '$name' of $document and docs/pictures/cost_$name.svg and .png"
done
