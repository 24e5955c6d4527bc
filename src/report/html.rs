//! A diagnosis as one page that needs nothing beside itself: no network, no script.

use std::fmt::{Display, Write as _};

use super::chart::chart;
use super::diagnosis::summary;
use super::escape::escape;
use crate::diagnose::{Diagnosed, Diagnosis, Mode, RankingRow, Recalibration, Strength, Trace};

/// Logs that one picture shows: more are too narrow to read.
const LOGS: usize = 40;
/// Rows of the ranking that stand open.
const OPEN_ROWS: usize = 12;
/// Points across a curve, and of all outputs' curves together: keeps the page of a model with many outputs below 2 MB.
const POINTS: (usize, usize) = (900, 6000);

const STYLE: &str = "
:root{color-scheme:light dark;--ink:#1b1f24;--faint:#59626d;--paper:#fff;--line:#d5dae0;--measured:#9aa3ad;--before:#c2410c;--after:#1d5fbf;--floor:#1d5fbf22;--held:#7a869420}
@media (prefers-color-scheme:dark){:root{--ink:#e8ebee;--faint:#a3adb8;--paper:#14181d;--line:#39424c;--measured:#7b8794;--before:#ff9a5a;--after:#72b3ff;--floor:#72b3ff2e;--held:#a3b0bf1f}}
*{box-sizing:border-box}
body{margin:0 auto;padding:1.2rem 1rem 3rem;max-width:60rem;background:var(--paper);color:var(--ink);font:16px/1.5 system-ui,sans-serif}
h1{font-size:1.5rem;line-height:1.25;margin:0 0 .2rem}
h2{font-size:1.15rem;margin:2.2rem 0 .6rem}
p{margin:.5rem 0}
.verdict{font-size:1.1rem;margin-bottom:1rem}
.faint{color:var(--faint)}
code{font-family:ui-monospace,monospace;font-size:.92em;overflow-wrap:anywhere}
figure{margin:1.4rem 0;break-inside:avoid}
figcaption{margin-bottom:.3rem}
.wide{overflow-x:auto}
svg{display:block;width:100%;min-width:36rem;height:auto;font:12px system-ui,sans-serif}
svg text{fill:var(--ink)}
svg text.small{fill:var(--faint)}
svg text.over{paint-order:stroke;stroke:var(--paper);stroke-width:3px}
.key::before{content:'';display:inline-block;width:1.4em;border-top:.22em solid;margin:0 .35em .22em 0}
.key{white-space:nowrap;margin-right:1em}
.key.measured::before{border-color:var(--measured)}.key.before::before{border-color:var(--before)}.key.after::before{border-color:var(--after)}
.key.area::before{border-top-width:.8em;margin-bottom:-.05em}.key.floor::before{border-color:var(--floor)}.key.held::before{border-color:var(--held)}
path.measured,path.before,path.after{fill:none;stroke-linejoin:round;stroke-linecap:round}
path.measured{stroke:var(--measured);stroke-width:2.6}path.before{stroke:var(--before);stroke-width:1.1}path.after{stroke:var(--after);stroke-width:1.1}
path.grid{stroke:var(--line);stroke-width:.6}path.tick{stroke:var(--faint)}
rect.frame{fill:none;stroke:var(--line)}rect.floor{fill:var(--floor)}rect.held{fill:var(--held)}
table{border-collapse:collapse;margin:.4rem 0 1rem;font-variant-numeric:tabular-nums}
caption{text-align:left;color:var(--faint);padding-bottom:.3rem}
th,td{text-align:right;padding:.22rem .9rem .22rem 0;border-bottom:1px solid var(--line);vertical-align:top}
th{font-weight:600}th.l,td.l{text-align:left}
tbody th{font-weight:400}td:not(.l){white-space:nowrap}
summary{cursor:pointer}
@media print{:root{color-scheme:light;--ink:#000;--faint:#444;--paper:#fff;--line:#bbb;--measured:#9aa3ad;--before:#c2410c;--after:#1d5fbf;--floor:#1d5fbf22;--held:#7a869420}body{max-width:none;font-size:11pt}svg{min-width:0}.wide{overflow:visible}tr{break-inside:avoid}}
";

fn percent(share: Option<f64>) -> String {
    match share {
        Some(v) if v > 0.0 && v < 0.0005 => "< 0.1 %".to_owned(),
        Some(v) if v.is_finite() && (v == 0.0 || v.abs() >= 0.0995) => format!("{:.0} %", 100.0 * v),
        Some(v) if v.is_finite() => format!("{:.1} %", 100.0 * v),
        _ => "–".to_owned(),
    }
    .replace('-', "−")
}

/// Four digits that say something.
fn number(value: Option<f64>) -> String {
    let Some(v) = value.filter(|v| v.is_finite()) else { return "–".to_owned() };
    let text = if v == 0.0 {
        "0".to_owned()
    } else if (1e-4..1e6).contains(&v.abs()) {
        let decimals = (3.0 - v.abs().log10().floor()).clamp(0.0, 8.0) as usize;
        format!("{v:.decimals$}")
    } else {
        format!("{v:.3e}")
    };
    text.replace('-', "−")
}

/// A table; columns in `left` hold words. The first column heads its row.
struct Table {
    html: String,
    left: &'static [usize],
}

impl Table {
    fn new(caption: &str, headings: &[&str], left: &'static [usize]) -> Self {
        let mut html = format!("<div class=\"wide\"><table><caption>{}</caption><thead><tr>", escape(caption));
        for (at, heading) in headings.iter().enumerate() {
            let class = if left.contains(&at) { " class=\"l\"" } else { "" };
            let _ = write!(html, "<th scope=\"col\"{class}>{}</th>", escape(heading));
        }
        Self { html: html + "</tr></thead><tbody>\n", left }
    }

    fn row(&mut self, cells: &[String]) {
        self.html += "<tr>";
        for (at, cell) in cells.iter().enumerate() {
            let class = if self.left.contains(&at) { " class=\"l\"" } else { "" };
            let (open, close) = if at == 0 { ("th scope=\"row\"", "th") } else { ("td", "td") };
            let _ = write!(self.html, "<{open}{class}>{}</{close}>", escape(cell));
        }
        self.html += "</tr>\n";
    }

    fn end(self) -> String {
        self.html + "</tbody></table></div>\n"
    }
}

fn code(name: impl Display) -> String {
    format!("<code>{}</code>", escape(&name.to_string()))
}

/// The page.
#[must_use]
pub fn page(diagnosed: &Diagnosed) -> String {
    let d = &diagnosed.diagnosis;
    let verdict = match d.cause.effects.as_slice() {
        [] => d.cause.verdict.clone(),
        found => found.iter().map(|e| format!("{} on {}", e.effect, e.channel)).collect::<Vec<_>>().join(" and "),
    };
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <title>Gap of {model}: {verdict}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>Sim-to-real gap of {model}</h1>\n\
         <p class=\"verdict\">Verdict: <strong>{verdict}</strong></p>\n",
        model = escape(&d.model),
        verdict = escape(&verdict),
    );
    for sentence in summary(diagnosed).lines() {
        let (what, rest) = sentence.split_once(": ").unwrap_or(("", sentence));
        let _ = writeln!(html, "<p><strong>{}:</strong> {}</p>", escape(what), quoted(rest));
    }
    for caveat in &diagnosed.caveats {
        let _ = writeln!(html, "<p><strong>Caveat:</strong> {}.</p>", quoted(&caveat.to_string()));
    }
    html += &curves(diagnosed);
    html += &cause(diagnosed);
    html += &size(d);
    html += &place(d);
    html += &checks(d);
    html += &data(d);
    html + "</main>\n</body>\n</html>\n"
}

/// Names in backquotes as code.
fn quoted(text: &str) -> String {
    let parts = text.split('`').enumerate();
    parts.map(|(at, part)| if at % 2 == 1 { code(part) } else { escape(part) }).collect()
}

/// One picture per output.
fn curves(diagnosed: &Diagnosed) -> String {
    let mut html = String::from("<h2>Measured and predicted</h2>\n");
    let outputs: Vec<&[Trace]> = diagnosed.traces.chunk_by(|a, b| a.output == b.output).collect();
    if outputs.is_empty() {
        return html + "<p>The model could not be simulated for a picture.</p>\n";
    }
    let with = diagnosed.traces.iter().any(|t| t.after.is_some());
    html += "<p><span class=\"key measured\">measured</span><span class=\"key before\">simulated</span>";
    if with {
        html += "<span class=\"key after\">simulated with what was found</span>";
    }
    html +=
        "<span class=\"key area floor\">noise floor, ± one standard deviation</span><span class=\"key area held\">held out</span></p>\n";
    let points = (POINTS.1 / outputs.len()).clamp(60, POINTS.0);
    for (at, traces) in outputs.into_iter().enumerate() {
        let shown = &traces[..traces.len().min(LOGS)];
        let name = shown.first().map_or("", |t| t.output.as_str());
        let title = format!("{}: measured and predicted over time", escape(name));
        let description = describe(&diagnosed.diagnosis, at);
        let _ = writeln!(html, "<figure>\n<figcaption>{} <span class=\"faint\">{description}</span></figcaption>", code(name));
        let _ = writeln!(html, "<div class=\"wide\">{}</div>", chart(at, shown, points, &title, &description));
        if traces.len() > shown.len() {
            let _ = writeln!(html, "<p class=\"faint\">The first {} of {} logs.</p>", shown.len(), traces.len());
        }
        html += "</figure>\n";
    }
    let logs: Vec<&str> = diagnosed.diagnosis.logs.iter().map(String::as_str).collect();
    let held = diagnosed.diagnosis.holdout.iter().map(|h| h.log.as_str()).filter(|h| !logs.contains(h));
    let all: Vec<String> = logs.iter().copied().chain(held).enumerate().map(|(i, log)| format!("{} {}", i + 1, code(log))).collect();
    if all.len() > 1 {
        let _ = writeln!(html, "<p class=\"faint\">Logs: {}.</p>", all.join(", "));
    }
    html
}

/// The numbers of one output, as its picture's description.
fn describe(d: &Diagnosis, output: usize) -> String {
    let mut text = d.gap.outputs.get(output).map_or_else(String::new, |gap| match gap.before {
        Some(_) => format!("error {} of the spread, noise floor {}", percent(gap.before), percent(gap.floor)),
        None => "it stands still".to_owned(),
    });
    if let Some(shrink) = d.shrink.outputs.get(output).filter(|s| s.before.is_some()) {
        let _ = write!(text, "; held out {}", percent(shrink.before));
        if !d.cause.contributions.is_empty() {
            let _ = write!(text, ", with what was found {}", percent(shrink.after));
        }
    }
    escape(&text)
}

/// The model's own numbers as a block.
fn recalibration(block: &Recalibration) -> String {
    let [learnt, held] = [percent(block.share.learnt), percent(block.share.held_out)];
    let caption = format!("The model's own numbers, {learnt} of what was learnt from and {held} of held-out data");
    let mut table = Table::new(&caption, &["number", "value", "95 % interval", "unit"], &[0, 3]);
    for p in &block.parameters {
        let interval = p.ci95.map_or_else(|| "–".to_owned(), |[l, u]| format!("{} to {}", number(Some(l)), number(Some(u))));
        table.row(&[p.name.clone(), number(p.value), interval, p.unit.clone()]);
    }
    let directions: String = block.directions.iter().map(|d| format!("<p>Told apart: {}.</p>\n", escape(d))).collect();
    table.end() + &directions
}

fn cause(diagnosed: &Diagnosed) -> String {
    let d = &diagnosed.diagnosis;
    let mut html = String::from("<h2>Cause</h2>\n");
    if !d.cause.contributions.is_empty() {
        let caption = if d.cause.effects.is_empty() { "What contributes, though not all is explained" } else { "What was found to act" };
        let headings = ["effect", "channel", "parameter", "value", "95 % interval", "unit", "share learnt", "held out", "how clear"];
        let mut table = Table::new(caption, &headings, &[0, 1, 2, 5, 8]);
        for c in &d.cause.contributions {
            for p in &c.parameters {
                let interval =
                    p.ci95.map_or_else(|| "at a bound".to_owned(), |[l, u]| format!("{} to {}", number(Some(l)), number(Some(u))));
                let (value, interval) =
                    if p.value.is_some() { (number(p.value), interval) } else { ("no limit".to_owned(), "–".to_owned()) };
                let clear = match (c.strength, c.surrogate) {
                    (_, true) => "predicts, not the physics' value",
                    (Strength::Clear, _) => "clear",
                    (Strength::Weak, _) => "weak",
                };
                let shares = [percent(c.share.learnt), percent(c.share.held_out), clear.to_owned()];
                let cells = [c.effect.clone(), c.channel.clone(), p.name.clone(), value, interval, p.unit.clone()];
                table.row(&[cells.as_slice(), shares.as_slice()].concat());
            }
        }
        html += &table.end();
    }
    if let Some(block) = d.cause.recalibration.as_ref().filter(|r| r.accepted) {
        html += &recalibration(block);
    }
    if let Some(rest) = d.cause.remainder.as_ref().filter(|r| r.share.learnt.is_some() && !d.cause.contributions.is_empty()) {
        let times = rest.above_floor.map(|t| format!(", {t:.1} times the noise floor")).unwrap_or_default();
        let (learnt, held) = (escape(&percent(rest.share.learnt)), escape(&percent(rest.share.held_out)));
        let _ = writeln!(html, "<p>What stays: {learnt} of what was learnt from, {held} of held-out data{times}.</p>");
    }
    for class in &d.cause.indistinguishable {
        let names: Vec<String> = class.iter().map(code).collect();
        let _ = writeln!(html, "<p>This data cannot tell apart: {}.</p>", names.join(", "));
    }
    if let Some(next) = &d.cause.next_experiment {
        let _ = writeln!(html, "<p>Next experiment: {}</p>", quoted(next));
    }
    let ranking = |caption: &str, rows: &[RankingRow]| {
        let mut table = Table::new(caption, &["effect", "channel", "probability", "error with it alone"], &[0, 1]);
        for row in rows {
            let (effect, channel, probability, after) = match row {
                RankingRow::Single(r) => (r.effect.clone(), r.channel.clone().unwrap_or_default(), r.probability, r.after),
                RankingRow::Pair(r) => {
                    let join = |i: usize| r.effects.iter().map(|e| e[i].as_str()).collect::<Vec<_>>().join(" + ");
                    (join(0), join(1), r.probability, r.after)
                }
            };
            table.row(&[effect, channel, percent(Some(probability)), percent(after)]);
        }
        table.end()
    };
    let (open, rest) = d.cause.ranking.split_at(d.cause.ranking.len().min(OPEN_ROWS));
    html += &ranking("Ranking; the error is in parts of the spread, on what was learnt from", open);
    if !rest.is_empty() {
        let _ =
            writeln!(html, "<details><summary>{} more candidates</summary>\n{}</details>", rest.len(), ranking("Ranking, continued", rest));
    }
    if !d.cause.not_tried.is_empty() {
        let list: Vec<String> = d.cause.not_tried.iter().map(|n| format!("{} ({})", code(&n.effect), escape(&n.why))).collect();
        let _ = writeln!(html, "<p class=\"faint\">Not tried: {}.</p>", list.join(", "));
    }
    html
}

fn size(d: &Diagnosis) -> String {
    let caption = "Root mean square error in parts of the spread, of predictions and of the noise that stays";
    let headings = ["output", "share of the gap", "learnt from: error", "floor", "held out: before", "after", "floor"];
    let mut table = Table::new(caption, &headings, &[0]);
    let found = !d.cause.contributions.is_empty();
    let after = |v: Option<f64>| if found { percent(v) } else { "–".to_owned() };
    for (gap, shrink) in d.gap.outputs.iter().zip(&d.shrink.outputs) {
        let cells = [
            percent(gap.share),
            percent(gap.before),
            percent(gap.floor),
            percent(shrink.before),
            after(shrink.after),
            percent(shrink.floor),
        ];
        table.row(&[std::slice::from_ref(&gap.name), cells.as_slice()].concat());
    }
    let s = &d.shrink;
    if d.gap.outputs.len() > 1 {
        let cells = [String::new(), percent(d.gap.before), percent(d.gap.floor), percent(s.before), after(s.after), percent(s.floor)];
        table.row(&[&["together".to_owned()], cells.as_slice()].concat());
    }
    let mut html = format!("<h2>How big, and how far it shrinks</h2>\n{}", table.end());
    if let (true, Some(_)) = (found, s.fraction) {
        let interval = s.ci95.map_or_else(String::new, |[l, u]| format!(" (95 %: {} to {})", percent(Some(l)), percent(Some(u))));
        let of = s.of_explainable.map_or_else(String::new, |v| format!(", {} of what can be explained", percent(Some(v))));
        let _ = writeln!(html, "<p>Shrink on held-out data: {}{interval}{of}.</p>", percent(s.fraction));
    }
    html
}

fn place(d: &Diagnosis) -> String {
    let w = &d.place;
    if w.times.is_empty() && w.bands.is_empty() && w.regimes.is_empty() {
        return String::new();
    }
    let caption = "Where the error above the floor is most dense; shares are of the output's own";
    let mut table = Table::new(caption, &["output", "in", "from", "to", "share"], &[0, 1]);
    let mut row = |output: &str, what: String, from: f64, to: f64, share: f64| {
        table.row(&[output.to_owned(), what, number(Some(from)), number(Some(to)), percent(Some(share))]);
    };
    for t in &w.times {
        row(&t.output, format!("time (s), {}", t.log), t.from_s, t.to_s, t.share);
    }
    for b in &w.bands {
        row(&b.output, "frequency (Hz)".to_owned(), b.from_hz, b.to_hz, b.share);
    }
    for r in &w.regimes {
        row(&r.output, r.variable.clone(), r.from, r.to, r.share);
    }
    format!("<h2>Where</h2>\n{}", table.end())
}

fn checks(d: &Diagnosis) -> String {
    if d.checks.is_empty() {
        return String::new();
    }
    let mut table = Table::new("What needs no dynamics", &["check", "channel", "passed", "finding"], &[0, 1, 2, 3]);
    for check in &d.checks {
        let name = serde_json::to_value(check.check).ok().and_then(|v| v.as_str().map(|s| s.replace('_', " "))).unwrap_or_default();
        let passed = check.ok.map_or("cannot be tested", |ok| if ok { "yes" } else { "no" });
        table.row(&[name, check.channel.clone(), passed.to_owned(), check.finding.clone()]);
    }
    format!("<h2>Checks</h2>\n{}", table.end())
}

fn data(d: &Diagnosis) -> String {
    let mode = match d.prediction.mode {
        Mode::Simulation => "a free run of the model",
        Mode::Predictor => "one-step predictions of a fixed observer",
    };
    let mut table = Table::new("What the shrink was measured on", &["log", "from (s)", "to (s)"], &[0]);
    for h in &d.holdout {
        table.row(&[h.log.clone(), number(Some(h.from_s)), number(Some(h.to_s))]);
    }
    let logs: Vec<String> = d.logs.iter().map(code).collect();
    format!(
        "<h2>Data</h2>\n<p>Learnt from: {}. Predicted means {mode}: {}.</p>\n{}<p class=\"faint\">deadtime {}</p>\n",
        logs.join(", "),
        escape(&d.prediction.why),
        table.end(),
        env!("CARGO_PKG_VERSION")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_a_name_holds_can_act_on_the_page() {
        assert_eq!(escape("<script>\"'&\u{7}"), "&lt;script&gt;&quot;&#39;&amp;\u{fffd}");
        assert_eq!(quoted("in `a<b>` and"), "in <code>a&lt;b&gt;</code> and");
    }

    #[test]
    fn what_is_not_a_number_is_a_dash() {
        assert_eq!([number(None), number(Some(f64::NAN)), percent(Some(f64::INFINITY)), percent(None)], ["–", "–", "–", "–"]);
        assert_eq!(
            [number(Some(0.161)), number(Some(-716_382.0)), number(Some(2e-7)), number(Some(0.0))],
            ["0.1610", "−716382", "2.000e−7", "0"]
        );
        assert_eq!(
            [percent(Some(0.0)), percent(Some(0.0123)), percent(Some(0.456)), percent(Some(-0.05))],
            ["0 %", "1.2 %", "46 %", "−5.0 %"]
        );
    }
}
