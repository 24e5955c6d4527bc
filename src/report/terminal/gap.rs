//! A diagnosis for a terminal.

use super::axis::share as bar;
use crate::report::diagnosis::{Line, by_horizon, caveat_lines, lines, nuisances, percent};
use crate::report::facts::{
    Cause, Label, Place, Ranked, Rivals, Shrink, described, probability, recalibrated, shared,
};
use crate::report::styled::{Role, Styled, WIDTH, cell, columns};
use crate::report::text::{estimate, unit};
use deadtime_gap::{
    Contribution, Diagnosed, Diagnosis, FoundEffect, FoundParameter, Share, Strength,
};
use deadtime_signal::text::shown;

/// A candidate less probable than this is only counted.
const PROBABLE: f64 = 0.005;
/// Cells of a bar.
const BAR: usize = 20;

/// A sentence behind its label.
fn line(text: &mut Styled, role: Role, label: Label, sentence: &str) {
    text.sentence((role, &format!("{}: ", label.word())), sentence, WIDTH, 2);
}

/// The answer in two sentences: which effect causes the gap and how sure that is; what speaks against it.
#[must_use]
pub fn verdict(d: &Diagnosis) -> Styled {
    let mut text = Styled::default();
    line(&mut text, Role::Strong, Label::Cause, &cause(d));
    line(&mut text, Role::Doubt, Label::Rivals, &rivals(d));
    text
}

/// The answer, how large the gap is, where it lies and how far it shrinks; what takes how much of it; the leading candidates. No line is wider than 80 columns.
#[must_use]
pub fn diagnosis(found: &Diagnosed, rows: usize) -> Styled {
    let d = &found.diagnosis;
    let mut text = verdict(d);
    for Line { label, text: first } in lines(found).iter().filter(|l| l.label == Label::First) {
        line(&mut text, Role::Doubt, *label, first);
    }
    line(&mut text, Role::Label, Label::Gap, &size(d));
    line(&mut text, Role::Label, Label::Place, &place(d));
    line(&mut text, Role::Label, Label::Shrink, &shrink(d));
    if let Some(horizons) = by_horizon(d) {
        line(&mut text, Role::Label, Label::Ahead, &horizons);
    }
    if let Some(rest) = described(d) {
        line(&mut text, Role::Doubt, Label::Rest, &format!("{rest}."));
    }
    if let Some(own) = nuisances(d) {
        line(&mut text, Role::Label, Label::Nuisances, &format!("{own}."));
    }
    for caveat in caveat_lines(found) {
        line(&mut text, Role::Doubt, caveat.label, &caveat.text);
    }
    if shared(d) {
        text.push(Role::Plain, "\n");
        budget(&mut text, d);
    }
    text.push(Role::Plain, "\n");
    ranking(&mut text, d, rows);
    if let Some(next) = &d.cause.next_experiment {
        text.push(Role::Plain, "\n");
        line(&mut text, Role::Label, Label::Next, next);
    }
    text
}

/// `delay 0.12993 s (0.12961 to 0.13022)`.
fn parameter(p: &FoundParameter) -> String {
    let Some(value) = p.value else { return format!("no {} limit", p.name) };
    match estimate(value, p.ci95) {
        (value, Some([lower, upper])) => {
            format!("{} {value}{} ({lower} to {upper})", p.name, unit(&p.unit))
        }
        (value, None) => format!("{} {value}{} (at a bound)", p.name, unit(&p.unit)),
    }
}

fn cause(d: &Diagnosis) -> String {
    let sure = format!("probability {}", percent(probability(d)));
    match Cause::of(d) {
        Cause::NothingMoves => "none could be looked for, because no output moves.".to_owned(),
        Cause::None => {
            format!("none; no effect of the catalogue helps and what is left is noise ({sure}).")
        }
        Cause::UnknownInPart => format!(
            "unknown in part; what is listed below contributes, and more than noise stays ({sure})."
        ),
        Cause::Unknown => format!(
            "unknown; more than noise stays that no effect of the catalogue explains ({sure})."
        ),
        Cause::Effects([one]) => {
            let parameters: Vec<String> = one.parameters.iter().map(parameter).collect();
            let channel = shown(&one.channel);
            format!("{} on `{channel}`, {}, {sure}.", one.effect, parameters.join(", "))
        }
        // Their numbers stand in the budget.
        Cause::Effects(several) => {
            let name = |e: &FoundEffect| format!("{} on `{}`", e.effect, shown(&e.channel));
            let names: Vec<String> = several.iter().map(name).collect();
            format!("{}, {sure}.", names.join(" and "))
        }
    }
}

fn rivals(d: &Diagnosis) -> String {
    match Rivals::of(d) {
        Rivals::Class(others) => {
            let others: Vec<String> = others.into_iter().map(shown).collect();
            format!("{} explain these logs as well.", others.join(", "))
        }
        Rivals::AnotherList(p) => format!(
            "another list of causes, longer or of other laws, with probability {}.",
            percent(p)
        ),
        Rivals::Next(r) => {
            let channel =
                r.channel.as_deref().map(|c| format!(" on `{}`", shown(c))).unwrap_or_default();
            format!("next comes {}{channel} with probability {}.", r.effect, percent(r.probability))
        }
        Rivals::Improbable => "none with a probability above 1 %.".to_owned(),
    }
}

fn size(d: &Diagnosis) -> String {
    let mode = d.prediction.words();
    match (d.gap.before, d.gap.floor) {
        (Some(before), Some(floor)) => {
            format!(
                "{}, {mode}, misses the logs by {} of their spread; noise is {}.",
                shown(&d.model),
                percent(before),
                percent(floor)
            )
        }
        _ => format!(
            "every output of {} stands still in the logs, so there is nothing to compare.",
            shown(&d.model)
        ),
    }
}

fn place(d: &Diagnosis) -> String {
    let Some(Place { output, time, band, regime }) = Place::of(d) else {
        return "nothing stands out above the noise.".to_owned();
    };
    let mut text = format!("{} of it in `{}`", percent(output.share), shown(&output.name));
    if let Some(t) = time {
        text += &format!(", mostly {:.2} to {:.2} s of {}", t.from_s, t.to_s, shown(&t.log));
    }
    if let Some(b) = band {
        text += &format!(", {:.2} to {:.2} Hz", b.from_hz, b.to_hz);
    }
    if let Some(r) = regime {
        text += &format!(", where {} is {:.4} to {:.4}", shown(&r.variable), r.from, r.to);
    }
    text + "."
}

fn shrink(d: &Diagnosis) -> String {
    match Shrink::of(d) {
        Shrink::Falls { before, after, floor, fraction } => {
            let decoded = d.shrink.decoded.map(percent);
            let decoded = decoded.map(|p| format!("; lost commands known, {p}"));
            let interval = d.shrink.ci95.map(|ends| ends.map(percent));
            let interval = interval.map(|[l, u]| format!(" ({l} to {u})"));
            let [before, after, fraction, floor] = [before, after, fraction, floor].map(percent);
            format!(
                "on held-out data {before} becomes {after}, by {fraction}{}{}; noise is {floor}.",
                interval.unwrap_or_default(),
                decoded.unwrap_or_default()
            )
        }
        Shrink::NothingAdded { before } => format!(
            "nothing was added to the model; its error on held-out data is {}.",
            percent(before)
        ),
        Shrink::NothingMoves => "no held-out output moves, so nothing can be said.".to_owned(),
    }
}

/// A line of the budget.
struct Takes {
    role: Role,
    what: String,
    share: Option<f64>,
    notes: Vec<String>,
}

fn contribution(c: &Contribution) -> Takes {
    let mut notes: Vec<String> = c.parameters.iter().map(parameter).collect();
    notes.extend(c.probability.map(|p| format!("acts with probability {}", percent(p))));
    if c.strength == Strength::Weak {
        notes.push("weak".to_owned());
    }
    if c.surrogate {
        notes.push("predicts, but is not the physics' value".to_owned());
    }
    if !c.class.is_empty() {
        let class: Vec<String> = c.class.iter().map(|n| shown(n)).collect();
        notes.push(format!("or {} in its place", class.join(" or ")));
    }
    let what = format!("{} {}", c.effect, shown(&c.channel));
    Takes { role: Role::Counts, what, share: c.share.learnt, notes }
}

/// Everything that takes a share of the gap, and what stays.
fn shares(d: &Diagnosis) -> Vec<Takes> {
    let line =
        |role, what: String, share: &Share, notes| Takes { role, what, share: share.learnt, notes };
    let mut lines: Vec<Takes> = d.cause.contributions.iter().map(contribution).collect();
    lines.extend(recalibrated(d).map(|r| {
        let notes = r.parameters.iter().map(parameter).collect();
        line(Role::Counts, "parameters recalibrated".to_owned(), &r.share, notes)
    }));
    lines.extend(d.cause.remainder.as_ref().map(|r| {
        let times = r.above_floor.map(|t| format!(" ({t:.1} times the noise)")).unwrap_or_default();
        line(Role::Doubt, format!("what stays{times}"), &r.share, Vec::new())
    }));
    if d.shrink.decoded.is_some() {
        lines.extend(d.shrink.of_explainable.map(|gained| Takes {
            role: Role::Counts,
            what: "a simulation gains".to_owned(),
            share: Some(gained),
            notes: vec!["nobody knows the sequence of a run that is still to come".to_owned()],
        }));
    }
    lines
}

/// What takes how much of the gap, and what stays.
fn budget(text: &mut Styled, d: &Diagnosis) {
    let lines = shares(d);
    let longest = lines.iter().map(|l| columns(&l.what)).max().unwrap_or(0);
    let name = longest.clamp(8, WIDTH - 2 - 2 - 5 - 2 - BAR);
    let known = d.shrink.decoded.is_some();
    let of_the_gap = if known { "of the gap, lost or late commands known" } else { "of the gap" };
    text.push(Role::Faint, format!("  {}  takes  {of_the_gap}\n", cell("cause", name, false)));
    for Takes { role, what, share, notes } in lines {
        let percentage = share.map_or_else(|| "–".to_owned(), percent);
        text.push(
            Role::Plain,
            format!("  {}  {}  ", cell(&what, name, false), cell(&percentage, 5, true)),
        );
        text.push(role, share.map(|s| bar(s, BAR)).unwrap_or_default()).push(Role::Plain, "\n");
        if !notes.is_empty() {
            text.sentence((Role::Plain, "    "), &notes.join("; "), WIDTH, 4);
        }
    }
}

/// The leading candidates, and how many more there are.
fn ranking(text: &mut Styled, d: &Diagnosis, rows: usize) {
    let candidate = |r: &Ranked<'_>| {
        let one = |[effect, channel]: &[&str; 2]| match *channel {
            "" => (*effect).to_owned(),
            channel => format!("{effect} {}", shown(channel)),
        };
        r.effects.iter().map(one).collect::<Vec<_>>().join(" + ")
    };
    let listed: Vec<(String, Ranked<'_>)> = d
        .cause
        .ranking
        .iter()
        .take(rows)
        .map(Ranked::of)
        .map(|row| (candidate(&row), row))
        .collect();
    let longest = listed.iter().map(|(name, _)| columns(name)).max().unwrap_or(0);
    let name = longest.clamp(9, WIDTH - 2 - 2 - 11 - 2 - BAR - 2 - 11);
    let (head, blank) = (cell("candidate", name, false), " ".repeat(BAR));
    text.push(Role::Faint, format!("  {head}  probability  {blank}  error alone\n"));
    for (candidate, row) in &listed {
        let p = row.probability;
        let role = if p < PROBABLE { Role::Faint } else { Role::Plain };
        let share = if p > 0.0 && p < PROBABLE { "< 1 %".to_owned() } else { percent(p) };
        let error = row.after.map_or_else(|| "–".to_owned(), |v| format!("{:.1} %", 100.0 * v));
        text.push(
            role,
            format!("  {}  {}  ", cell(candidate, name, false), cell(&share, 11, true)),
        );
        text.push(Role::Counts, cell(&bar(p, BAR), BAR, false))
            .push(role, format!("  {}\n", cell(&error, 11, true)));
    }
    let rest: Vec<String> = unlisted(d, listed.len()).into_iter().chain(not_tried(d)).collect();
    if !rest.is_empty() {
        text.sentence((Role::Faint, "  "), &format!("{}.", rest.join("; ")), WIDTH, 2);
    }
}

/// How many rows of the ranking are not listed, and how probable they are.
fn unlisted(d: &Diagnosis, listed: usize) -> Option<String> {
    let rest = d.cause.ranking.get(listed..).filter(|rest| !rest.is_empty())?;
    let most = rest.iter().map(|row| Ranked::of(row).probability).fold(0.0, f64::max);
    let most = if most < 0.01 {
        "each below 1 %".to_owned()
    } else {
        format!("{} at most", percent(most))
    };
    Some(format!("{} more candidates, {most}", rest.len()))
}

/// How many candidates were not tried, by reason.
fn not_tried(d: &Diagnosis) -> Vec<String> {
    let mut reasons: Vec<(&str, usize)> = Vec::new();
    for left in &d.cause.not_tried {
        match reasons.iter_mut().find(|(why, _)| *why == left.why) {
            Some((_, count)) => *count += 1,
            None => reasons.push((&left.why, 1)),
        }
    }
    reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let (named, others) = reasons.split_at(reasons.len().min(3));
    let mut said: Vec<String> =
        named.iter().map(|(why, count)| format!("{count} not tried: {why}")).collect();
    let others: usize = others.iter().map(|(_, count)| count).sum();
    if others > 0 {
        said.push(format!("{others} not tried for other reasons"));
    }
    said
}
