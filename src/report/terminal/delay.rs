//! Dead times for a terminal.

use super::axis::Axis;
use crate::report::estimate::{A_HANDFUL, preamble, single_events, warning};
use crate::report::styled::{Role, Styled, WIDTH, cell, columns, wrapped};
use crate::report::text::{delay, delay_cells, seconds};
use deadtime_delay::Outcome;
use deadtime_delay::report::{Bias, Estimate, Pair, Report, Searched};
use deadtime_delay::track::Tracked;
use deadtime_signal::text::shown;

/// Methods and notes that are named where more would bury the answer.
const NAMED: usize = 3;
/// Lines of a track that a person reads; the file has every sample.
const TRACK_LINES: usize = 20;
/// A bar is as wide as the other columns leave it, within these bounds.
const BAR: [usize; 2] = [10, 34];

/// The answer to every pair, two lines each: what to believe and who says so; what speaks against it.
#[must_use]
pub fn brief(report: &Report) -> Styled {
    let mut text = Styled::default();
    for pair in &report.pairs {
        if report.pairs.len() > 1 {
            title(&mut text, pair);
        }
        answer(&mut text, pair, report);
    }
    text
}

/// The answer to every pair, the methods that count on a common axis, how many do not count and why, and what was searched; no line is wider than 80 columns.
#[must_use]
pub fn short(report: &Report) -> Styled {
    let mut text = Styled::default();
    for pair in &report.pairs {
        title(&mut text, pair);
        answer(&mut text, pair, report);
        text.push(Role::Plain, "\n");
        let rows = rows(pair);
        table(&mut text, pair, &rows, report.sample_time_s);
        beneath(&mut text, pair, &rows);
        if let Some(track) = &pair.track {
            text.push(Role::Plain, "\n");
            against_time(&mut text, track, report.sample_time_s);
        }
        text.push(Role::Plain, "\n");
    }
    for line in wrapped(&preamble(report), WIDTH, 2) {
        text.push(Role::Faint, line).push(Role::Plain, "\n");
    }
    text
}

/// The pair that is meant.
fn title(text: &mut Styled, pair: &Pair) {
    let target = if pair.output == "*" { "the states" } else { &pair.output };
    for line in wrapped(&format!("{} → {}", shown(&pair.input), shown(target)), WIDTH, 2) {
        text.push(Role::Strong, line).push(Role::Plain, "\n");
    }
}

/// What to believe and who says so; what speaks against it.
fn answer(text: &mut Styled, pair: &Pair, report: &Report) {
    let step_s = report.sample_time_s;
    let (verdict, grounds) = (&pair.verdict, &pair.verdict.grounds);
    let why = without_lists(&verdict.why, pair);
    match (verdict.delay_s, verdict.ci95_s) {
        (Some(delay_s), Some(_)) => {
            let who = match grounds.agree.as_slice() {
                [] => why,
                [one] => format!("{one} alone"),
                [one, other] => format!("{one} and {other}"),
                [one, rest @ ..] => format!("{one} and {} more", rest.len()),
            };
            let (value, ends) = delay(delay_s, verdict.ci95_s, step_s);
            let ends = ends.map_or_else(String::new, |e| format!(" ({} s)", e.join(" to ")));
            text.sentence(
                (Role::Strong, &format!("Believe a dead time of {value} s")),
                &format!("{ends}{}: {who}.", counted(delay_s, report)),
                WIDTH,
                2,
            );
        }
        _ if pair.moving.is_some() => {
            let (label, rest) =
                why.split_once(": ").map_or(("", why.as_str()), |(label, rest)| (label, rest));
            let label = if label.is_empty() { String::new() } else { format!("{label}:") };
            text.sentence((Role::Strong, &label), &format!(" {rest}."), WIDTH, 2);
        }
        _ => {
            text.sentence((Role::Doubt, "Believe none of it: "), &format!("{why}."), WIDTH, 2);
        }
    }
    if let Some(jitter) = &pair.jitter {
        text.sentence((Role::Plain, ""), &format!("{}.", single_events(jitter, step_s)), WIDTH, 2);
    }
    let ci95_s =
        |method: &str| pair.estimates.iter().find(|e| e.method == method).and_then(|e| e.ci95_s);
    let mut others: Vec<String> = grounds
        .differ
        .iter()
        .take(NAMED)
        .map(|(m, d)| format!("{m} {} s", delay(*d, ci95_s(m), step_s).0))
        .collect();
    if grounds.differ.len() > NAMED {
        others.push(format!("{} more", grounds.differ.len() - NAMED));
    }
    let against: Vec<String> = [others.join(", ")]
        .into_iter()
        .filter(|o| !o.is_empty())
        .chain(grounds.doubts.iter().cloned())
        .chain(warning(pair, step_s))
        .collect();
    if !against.is_empty() {
        text.sentence((Role::Doubt, "Against it: "), &format!("{}.", against.join("; ")), WIDTH, 2);
    } else if verdict.delay_s.is_some() {
        text.sentence((Role::Doubt, "Against it: "), "nothing that counts.", WIDTH, 2);
    }
}

/// The same in samples, and as MATLAB counts it, where the relative degree is one number.
fn counted(delay_s: f64, report: &Report) -> String {
    let Searched::Samples { bias, .. } = &report.searched else { return String::new() };
    let samples = delay_s / report.sample_time_s;
    let shown = format!("{samples:.1}");
    let shown = shown.strip_suffix(".0").unwrap_or(&shown);
    let unit = if shown == "1" { "sample" } else { "samples" };
    let (degree, holds) = match bias {
        Bias::Assumed => (1, ", which counts the hold"),
        Bias::Given(degree) => (*degree, ""),
        Bias::Model(_) => return format!(", {shown} {unit}"),
    };
    format!(", {shown} {unit} (nk = {} in MATLAB{holds})", samples.round() as usize + degree)
}

/// A sentence whose lists of more methods than a few are counts.
pub(in crate::report) fn without_lists(why: &str, pair: &Pair) -> String {
    let name = |word: &str| {
        let bare = word.trim_matches(|c: char| "(),;:.".contains(c));
        pair.estimates.iter().any(|e| e.method == bare)
    };
    let (mut words, mut list): (Vec<String>, Vec<&str>) = (Vec::new(), Vec::new());
    for word in why.split(' ') {
        if name(word) {
            list.push(word);
            if word.ends_with(',') {
                continue;
            }
        }
        if list.len() > NAMED && name(word) {
            let end = word.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_');
            words.push(format!("{} methods{end}", list.len()));
        } else {
            words.extend(list.iter().map(|w| (*w).to_owned()));
            if !name(word) {
                words.push(word.to_owned());
            }
        }
        list.clear();
    }
    words.extend(list.iter().map(|w| (*w).to_owned()));
    words.join(" ")
}

/// Of many methods those whose answers count, or else those that have one; of a handful all.
fn rows(pair: &Pair) -> Vec<&Estimate> {
    let all = || pair.estimates.iter();
    if pair.estimates.len() <= A_HANDFUL {
        return all().collect();
    }
    let counted: Vec<&Estimate> = all().filter(|e| e.counts()).collect();
    if !counted.is_empty() { counted } else { all().filter(|e| e.delay_s.is_some()).collect() }
}

/// The columns of the table of methods: their widths, and the axis of the last.
struct Columns {
    name: usize,
    value: usize,
    interval: usize,
    bar: usize,
    axis: Option<Axis>,
}

impl Columns {
    fn of(pair: &Pair, rows: &[&Estimate], stated: &[String; 2], step_s: f64) -> Self {
        let widest = |heading: &str, least: &str, of: &dyn Fn(&Estimate) -> String| {
            let texts = rows.iter().map(|e| columns(&of(e)));
            texts.chain([columns(heading), columns(least)]).max().unwrap_or(0)
        };
        let answer = |e: &Estimate, at: usize| delay_cells(e.delay_s, e.ci95_s, step_s)[at].clone();
        let name = widest("method", "believed", &|e| e.method.clone());
        let value = widest("answer (s)", &stated[0], &|e| answer(e, 0));
        let interval = widest("95 % interval (s)", &stated[1], &|e| answer(e, 1));
        let counts = 6;
        let taken = 2 + name + 2 + value + 2 + interval + 2 + 2 + counts;
        let bar = WIDTH.saturating_sub(taken).clamp(BAR[0], BAR[1]);
        let intervals = || rows.iter().filter(|e| e.counts()).filter_map(|e| e.ci95_s);
        let axis = match (pair.verdict.delay_s, pair.verdict.ci95_s) {
            (Some(delay), Some(ci)) => Axis::around(delay, ci, intervals(), bar),
            _ => Axis::over(rows.iter().filter_map(|e| e.ci95_s), bar),
        };
        Self { name, value, interval, bar, axis }
    }

    /// The cells of a line but its drawing.
    fn line(&self, [name, value, interval]: [&str; 3]) -> String {
        let cells = [
            cell(name, self.name, false),
            cell(value, self.value, true),
            cell(interval, self.interval, true),
        ];
        format!("  {}  ", cells.join("  "))
    }
}

/// The ends of an axis above it.
fn ends(axis: Axis, bar: usize, step_s: f64) -> String {
    let [from, to] = axis.ends().map(|v| seconds(v, step_s));
    format!("{from}{}", cell(&to, bar.saturating_sub(columns(&from)), true))
}

/// One line a method: its answer, the interval, both on the common axis, whether it counts; the verdict above.
fn table(text: &mut Styled, pair: &Pair, rows: &[&Estimate], step_s: f64) {
    if rows.is_empty() {
        return;
    }
    let (believed, verdict) = (pair.verdict.ci95_s, pair.verdict.delay_s);
    let stated = delay_cells(verdict, believed, step_s);
    let shape = Columns::of(pair, rows, &stated, step_s);
    let labels = shape.axis.map_or_else(String::new, |axis| ends(axis, shape.bar, step_s));
    let heads = shape.line(["method", "answer (s)", "95 % interval (s)"]);
    text.push(Role::Faint, format!("{heads}{}  counts\n", cell(&labels, shape.bar, false)));
    if let (Some(delay), Some(ci)) = (verdict, believed) {
        let drawn = shape.axis.map_or_else(String::new, |a| a.bar(delay, Some(ci), None));
        let line = shape.line(["believed", &stated[0], &stated[1]]) + &drawn;
        text.push(Role::Strong, line.trim_end()).push(Role::Plain, "\n");
    }
    for e in rows {
        let (role, counts) = match (e.outcome, e.counts()) {
            (_, true) => (Role::Counts, "yes"),
            (Outcome::Found, false) => (Role::Faint, "no"),
            _ => (Role::Faint, "–"),
        };
        let drawn = match (shape.axis, e.delay_s) {
            (Some(axis), Some(delay)) => axis.bar(delay, e.ci95_s, believed),
            _ => e.outcome.name().replace('_', " "),
        };
        let [at, between] = delay_cells(e.delay_s, e.ci95_s, step_s);
        let plain = if role == Role::Faint { Role::Faint } else { Role::Plain };
        text.push(plain, shape.line([&e.method, &at, &between]))
            .push(role, cell(&drawn, shape.bar, false))
            .push(plain, format!("  {counts}\n"));
    }
}

/// How many methods do not count or found nothing, with the reason; what the record shows; the notes of the rows.
fn beneath(text: &mut Styled, pair: &Pair, rows: &[&Estimate]) {
    let mut groups: Vec<(bool, String, usize)> = Vec::new();
    for e in pair.estimates.iter().filter(|e| !e.counts()) {
        let (rejected, reason) = match (e.outcome, e.distrust.as_slice()) {
            (Outcome::Found, []) => (true, "a model that the data contradict".to_owned()),
            (Outcome::Found, reasons) => {
                (true, reasons.iter().map(|c| c.words()).collect::<Vec<_>>().join(" and "))
            }
            _ => (false, e.outcome.name().replace('_', " ")),
        };
        match groups.iter_mut().find(|(r, known, _)| *r == rejected && *known == reason) {
            Some((_, _, count)) => *count += 1,
            None => groups.push((rejected, reason, 1)),
        }
    }
    groups.sort_by_key(|(_, _, count)| std::cmp::Reverse(*count));
    for (rejected, label, before) in [(true, "Not counted: ", "for "), (false, "No answer: ", "")] {
        let all: Vec<String> = groups
            .iter()
            .filter(|g| g.0 == rejected)
            .map(|(_, why, count)| format!("{count} {before}{why}"))
            .collect();
        if !all.is_empty() {
            text.sentence((Role::Label, label), &format!("{}.", all.join("; ")), WIDTH, 2);
        }
    }
    if !pair.findings.is_empty() {
        let all: Vec<String> = pair
            .findings
            .iter()
            .map(|f| format!("{} ({})", f.condition.words(), f.evidence))
            .collect();
        text.sentence(
            (Role::Label, "The record shows: "),
            &format!("{}.", all.join("; ")),
            WIDTH,
            2,
        );
    }
    // Where nobody answered, the notes say why.
    let of: Vec<&Estimate> =
        if rows.is_empty() { pair.estimates.iter().collect() } else { rows.to_vec() };
    let notes: Vec<(&str, &str)> =
        of.iter().filter_map(|e| Some((e.method.as_str(), e.note.as_deref()?))).collect();
    let named = if pair.estimates.len() > A_HANDFUL { NAMED } else { A_HANDFUL };
    for (method, note) in notes.iter().take(named) {
        text.sentence((Role::Label, &format!("{method}: ")), &format!("{note}."), WIDTH, 2);
    }
    if notes.len() > named {
        text.sentence(
            (Role::Faint, ""),
            &format!("{} more have notes.", notes.len() - named),
            WIDTH,
            2,
        );
    }
}

/// The delay against time, a line for each equal part of it.
fn against_time(text: &mut Styled, track: &Tracked, step_s: f64) {
    let count = track.time_s.len();
    let lines = TRACK_LINES.min(count);
    let at: Vec<usize> = (0..lines)
        .map(
            |line| if count <= TRACK_LINES { line } else { line * (count - 1) / (TRACK_LINES - 1) },
        )
        .collect();
    let band = |i: usize| [track.low_s[i], track.high_s[i]];
    let several = at.iter().any(|&i| track.record[i] > 0);
    let words = |i: usize| delay_cells(Some(track.delay_s[i]), Some(band(i)), step_s);
    let band_width = at.iter().map(|&i| columns(&words(i)[1])).max().unwrap_or(0).max(13);
    let bar = WIDTH.saturating_sub(2 + 8 + 9 + 2 + 13 + 2 + band_width + 2).clamp(BAR[0], BAR[1]);
    let Some(axis) = Axis::over(at.iter().map(|&i| band(i)), bar) else { return };
    let record =
        |text: &str| if several { format!("{}  ", cell(text, 6, true)) } else { String::new() };
    let labels = ends(axis, bar, step_s);
    text.push(
        Role::Faint,
        format!(
            "  {}{}  dead time (s)  {}  {labels}\n",
            record("record"),
            cell("time (s)", 9, true),
            cell("95 % band (s)", band_width, true)
        ),
    );
    for i in at {
        let [value, ends] = words(i);
        let cells = [
            cell(&seconds(track.time_s[i], step_s), 9, true),
            cell(&value, 13, true),
            cell(&ends, band_width, true),
        ];
        let line =
            format!("  {}{}  ", record(&(track.record[i] + 1).to_string()), cells.join("  "));
        text.push(Role::Plain, line)
            .push(Role::Counts, axis.bar(track.delay_s[i], Some(band(i)), None).trim_end())
            .push(Role::Plain, "\n");
    }
}
