// Curves as files for spreadsheets, made from what the page holds.

/** A table of charts: frame, seconds, and a column for each line. */
export function tableOf(data, charts) {
  const lines = charts.flatMap((chart) => chart.lines.map((line) => [chart, line]));
  const head = ["frame", "time_s", ...lines.map(([chart, line]) => title(chart, line))];
  const rows = [head.map(quoted).join(",")];
  for (let frame = 0; frame < data.frames; frame += 1) {
    const values = lines.map(([, line]) => line.values[frame] ?? "");
    const time = ((data.first + frame) / data.rate).toFixed(6);
    rows.push([data.first + frame, time, ...values].join(","));
  }
  return `${rows.join("\r\n")}\r\n`;
}

/** Save charts as a file of that name. */
export function downloadCharts(data, charts, name) {
  const file = new Blob([tableOf(data, charts)], { type: "text/csv;charset=utf-8" });
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = `${plain(data.name)}_${plain(name)}.csv`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function title(chart, line) {
  const unit = chart.unit ? ` [${chart.unit}]` : "";
  return chart.lines.length > 1 ? `${chart.title}: ${line.name}${unit}` : `${chart.title}${unit}`;
}

/** As RFC 4180 has it; a sign in front that spreadsheets would compute is set apart. */
function quoted(text) {
  const safe = /^[=+\-@\t\r]/.test(text) ? `'${text}` : text;
  return /[",\r\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
}

function plain(name) {
  return name.replace(/[^\p{L}\p{N}.-]+/gu, "_").replace(/^_+|_+$/g, "") || "curves";
}
