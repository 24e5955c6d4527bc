//! Dead times for a terminal.

use super::axis::Axis;
use crate::report::estimate::{A_HANDFUL, preamble, single_events, warning};
use crate::report::standing::{Standing, counted as left_out, reason};
use crate::report::styled::{Role, Styled, WIDTH, cell, columns, cut, wrapped};
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

/// Lines of an answer with `--brief`.
const BRIEF: usize = 3;

/// The answer to every pair in three lines at most: dead time, methods that agree and differ, the first warning.
#[must_use]
pub fn brief(report: &Report) -> Styled {
    let mut text = Styled::default();
    for pair in &report.pairs {
        let name = format!("{} → {}: ", shown(&pair.input), shown(target(pair)));
        let name = if report.pairs.len() > 1 { name } else { String::new() };
        for (at, line) in brief_lines(pair, report, &name).into_iter().enumerate() {
            let role = match (at, pair.verdict.delay_s) {
                (0, None) => Role::Doubt,
                (0, _) => Role::Strong,
                _ => Role::Plain,
            };
            text.push(role, cut(&line, WIDTH)).push(Role::Plain, "\n");
        }
    }
    text
}

fn brief_lines(pair: &Pair, report: &Report, name: &str) -> Vec<String> {
    if pair.verdict.delay_s.is_none() {
        let why = without_lists(&pair.verdict.why, pair);
        let first = why.split("; ").next().unwrap_or_default();
        let text = match pair.moving {
            Some(_) => format!("{name}{first}."),
            None => format!("{name}no trusted dead time: {first}."),
        };
        let lines = wrapped(&text, WIDTH, 2);
        let all = lines.len();
        let mut kept: Vec<String> = lines.into_iter().take(BRIEF).collect();
        if let Some(last) = kept.last_mut().filter(|_| all > BRIEF) {
            *last = cut(&format!("{last} …"), WIDTH);
        }
        return kept;
    }
    let methods = match differing(pair, report.sample_time_s) {
        Some(differ) => format!("agree: {}; differ: {differ}", agreeing(pair)),
        None => format!("agreeing methods: {}; none differs", agreeing(pair)),
    };
    let warning =
        pair.verdict.grounds.doubts.iter().cloned().chain(warning(pair, report.sample_time_s));
    let first = warning.map(|w| format!("  warning: {w}")).next();
    let head = format!("{}{}", value(pair, report), counted(pair, report));
    // The number is never cut, a long name is.
    let room = WIDTH.saturating_sub(columns(&head) + 2);
    let name = match name.strip_suffix(": ") {
        Some(pair) => format!("{}: ", cut(pair, room)),
        None => String::new(),
    };
    [name + &head, format!("  {methods}")].into_iter().chain(first).collect()
}

/// The answer to every pair, its methods on a common axis, the number of methods left out with the reasons, and the search. No line is wider than 80 columns.
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

/// The target of the estimate: an output, or the states.
fn target(pair: &Pair) -> &str {
    if pair.output == "*" { "the states" } else { &pair.output }
}

/// The pair that is meant.
fn title(text: &mut Styled, pair: &Pair) {
    for line in wrapped(&format!("{} → {}", shown(&pair.input), shown(target(pair))), WIDTH, 2) {
        text.push(Role::Strong, line).push(Role::Plain, "\n");
    }
}

/// `dead time 0.140 s (0.117 to 0.151 s)`.
fn value(pair: &Pair, report: &Report) -> String {
    let Some(delay_s) = pair.verdict.delay_s else { return String::new() };
    let (value, ends) = delay(delay_s, pair.verdict.ci95_s, report.sample_time_s);
    let ends = ends.map_or_else(String::new, |e| format!(" ({} s)", e.join(" to ")));
    format!("dead time {value} s{ends}")
}

/// The methods that agree, the heaviest first.
fn agreeing(pair: &Pair) -> String {
    match pair.verdict.grounds.agree.as_slice() {
        [] => "none".to_owned(),
        [one] => format!("{one} alone"),
        [one, other] => format!("{one} and {other}"),
        [one, rest @ ..] => format!("{one} and {} more", rest.len()),
    }
}

/// The trusted methods that do not agree, with their answers.
fn differing(pair: &Pair, step_s: f64) -> Option<String> {
    let differ = &pair.verdict.grounds.differ;
    let ci95_s =
        |method: &str| pair.estimates.iter().find(|e| e.method == method).and_then(|e| e.ci95_s);
    let mut others: Vec<String> = differ
        .iter()
        .take(NAMED)
        .map(|(m, d)| format!("{m} {} s", delay(*d, ci95_s(m), step_s).0))
        .collect();
    if differ.len() > NAMED {
        others.push(format!("{} more", differ.len() - NAMED));
    }
    (!others.is_empty()).then(|| others.join(", "))
}

/// The dead time, the methods that agree, those that differ, and warnings.
fn answer(text: &mut Styled, pair: &Pair, report: &Report) {
    let step_s = report.sample_time_s;
    let why = without_lists(&pair.verdict.why, pair);
    let mut sentence = |role, label: &str, rest: &str| {
        text.sentence((role, label), rest, WIDTH, 2);
    };
    match pair.verdict.delay_s {
        Some(_) => {
            let line = value(pair, report).replacen('d', "D", 1);
            sentence(Role::Strong, &line, &format!("{}.", counted(pair, report)));
            sentence(Role::Label, "Agreeing methods: ", &format!("{}.", agreeing(pair)));
        }
        None if pair.moving.is_some() => {
            let (label, rest) =
                why.split_once(": ").map_or(("", why.as_str()), |(label, rest)| (label, rest));
            let label = if label.is_empty() { String::new() } else { format!("{label}:") };
            sentence(Role::Strong, &label, &format!(" {rest}."));
        }
        None => sentence(Role::Doubt, "No trusted dead time: ", &format!("{why}.")),
    }
    if let Some(jitter) = &pair.jitter {
        sentence(Role::Plain, "", &format!("{}.", single_events(jitter, step_s)));
    }
    match differing(pair, step_s) {
        Some(differ) => sentence(Role::Doubt, "Differing: ", &format!("{differ}.")),
        None if pair.verdict.delay_s.is_some() => {
            sentence(Role::Label, "Differing: ", "none of the trusted methods.");
        }
        None => {}
    }
    for doubt in pair.verdict.grounds.doubts.iter().cloned().chain(warning(pair, step_s)) {
        sentence(Role::Doubt, "Warning: ", &format!("{doubt}."));
    }
}

/// The same in samples, and as MATLAB counts it, where the relative degree is one number.
fn counted(pair: &Pair, report: &Report) -> String {
    let (Searched::Samples { bias, .. }, Some(delay_s)) = (&report.searched, pair.verdict.delay_s)
    else {
        return String::new();
    };
    let samples = delay_s / report.sample_time_s;
    let shown = format!("{samples:.1}");
    let shown = shown.strip_suffix(".0").unwrap_or(&shown);
    let unit = if shown == "1" { "sample" } else { "samples" };
    let degree = match bias {
        Bias::Assumed if pair.two_sensors => 0,
        Bias::Assumed => 1,
        Bias::Given(degree) => *degree,
        Bias::Model(_) => return format!(", {shown} {unit}"),
    };
    format!(", {shown} {unit}, nk = {} in MATLAB", samples.round() as usize + degree)
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

/// Of many methods those that the verdict uses, or else those that have an answer; of a handful all. Agreeing ones come first.
fn rows(pair: &Pair) -> Vec<&Estimate> {
    let all = || pair.estimates.iter();
    if pair.estimates.len() <= A_HANDFUL {
        return all().collect();
    }
    let standing = |e: &&Estimate| Standing::of(pair, e);
    let mut used: Vec<&Estimate> = all().filter(|e| standing(e).used()).collect();
    used.sort_by_key(|e| standing(e) == Standing::Differs);
    if !used.is_empty() { used } else { all().filter(|e| e.delay_s.is_some()).collect() }
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
        let name = widest("method", "verdict", &|e| e.method.clone());
        let value = widest("answer (s)", &stated[0], &|e| answer(e, 0));
        let interval = widest("95 % interval (s)", &stated[1], &|e| answer(e, 1));
        let counts = 8;
        let taken = 2 + name + 2 + value + 2 + interval + 2 + 2 + counts;
        let bar = WIDTH.saturating_sub(taken).clamp(BAR[0], BAR[1]);
        let intervals =
            || rows.iter().filter(|e| Standing::of(pair, e).used()).filter_map(|e| e.ci95_s);
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

/// One line a method: its answer, the interval, both on the common axis, its standing in the verdict; the verdict above.
fn table(text: &mut Styled, pair: &Pair, rows: &[&Estimate], step_s: f64) {
    if rows.is_empty() {
        return;
    }
    let (believed, verdict) = (pair.verdict.ci95_s, pair.verdict.delay_s);
    let stated = delay_cells(verdict, believed, step_s);
    let shape = Columns::of(pair, rows, &stated, step_s);
    let labels = shape.axis.map_or_else(String::new, |axis| ends(axis, shape.bar, step_s));
    let heads = shape.line(["method", "answer (s)", "95 % interval (s)"]);
    text.push(Role::Faint, format!("{heads}{}\n", labels.trim_end()));
    if let (Some(delay), Some(ci)) = (verdict, believed) {
        let drawn = shape.axis.map_or_else(String::new, |a| a.bar(delay, Some(ci), None));
        let line = shape.line(["verdict", &stated[0], &stated[1]]) + &drawn;
        text.push(Role::Strong, line.trim_end()).push(Role::Plain, "\n");
    }
    for e in rows {
        let standing = Standing::of(pair, e);
        let role = match standing {
            Standing::Agrees => Role::Counts,
            Standing::Differs => Role::Doubt,
            Standing::LeftOut | Standing::Silent => Role::Faint,
        };
        let drawn = match (shape.axis, e.delay_s) {
            (Some(axis), Some(delay)) => axis.bar(delay, e.ci95_s, believed),
            _ => e.outcome.name().replace('_', " "),
        };
        let [at, between] = delay_cells(e.delay_s, e.ci95_s, step_s);
        let plain = if role == Role::Faint { Role::Faint } else { Role::Plain };
        text.push(plain, shape.line([&e.method, &at, &between]))
            .push(role, cell(&drawn, shape.bar, false))
            .push(plain, format!("  {}\n", standing.word()));
    }
}

/// The number of methods left out or without an answer, with the reason; the findings on the record; the notes of the rows.
fn beneath(text: &mut Styled, pair: &Pair, rows: &[&Estimate]) {
    let mut groups: Vec<(bool, String, usize)> = Vec::new();
    for e in pair.estimates.iter().filter(|e| !Standing::of(pair, e).used()) {
        // Without a verdict an answer without a reason is not left out.
        let why = reason(e).filter(|_| pair.verdict.delay_s.is_some() || !e.counts());
        let (rejected, why) = match why {
            Some(why) => (true, why),
            None if e.outcome == Outcome::Found => continue,
            None => (false, e.outcome.name().replace('_', " ")),
        };
        match groups.iter_mut().find(|(r, known, _)| *r == rejected && *known == why) {
            Some((_, _, count)) => *count += 1,
            None => groups.push((rejected, why, 1)),
        }
    }
    groups.sort_by_key(|(_, _, count)| std::cmp::Reverse(*count));
    for (rejected, label) in [(true, "Left out: "), (false, "No answer: ")] {
        let all: Vec<String> = groups
            .iter()
            .filter(|g| g.0 == rejected)
            .map(|(_, why, count)| match rejected {
                true => left_out(*count, why),
                false => format!("{count} {why}"),
            })
            .collect();
        if !all.is_empty() {
            let joint = if rejected { ". " } else { "; " };
            text.sentence((Role::Label, label), &format!("{}.", all.join(joint)), WIDTH, 2);
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
    // Without any answer, the notes have the reasons.
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
