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
