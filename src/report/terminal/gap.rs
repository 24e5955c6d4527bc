//! A diagnosis for a terminal.

use super::axis::share as bar;
use crate::report::diagnosis::{
    by_horizon, described, first, nuisances, percent, probability, shared,
};
use crate::report::styled::{Role, Styled, WIDTH, cell, columns};
use crate::report::text::estimate;
use deadtime_gap::{Diagnosed, Diagnosis, FoundParameter, RankingRow, Share, Strength};
use deadtime_signal::text::shown;

/// A candidate less probable than this is only counted.
const PROBABLE: f64 = 0.005;
/// Cells of a bar.
const BAR: usize = 20;

/// The answer in two sentences: which effect causes the gap and how sure that is; what speaks against it.
#[must_use]
pub fn verdict(d: &Diagnosis) -> Styled {
    let mut text = Styled::default();
    text.sentence((Role::Strong, "Cause: "), &cause(d), WIDTH, 2);
    text.sentence((Role::Doubt, "Rivals: "), &rivals(d), WIDTH, 2);
    text
}

/// The answer, how large the gap is, where it lies and how far it shrinks; what takes how much of it; the leading candidates. No line is wider than 80 columns.
#[must_use]
pub fn diagnosis(found: &Diagnosed, rows: usize) -> Styled {
    let d = &found.diagnosis;
    let mut text = verdict(d);
    if let Some(first) = first(found) {
        text.sentence((Role::Doubt, "First: "), first.trim_start_matches("First: "), WIDTH, 2);
    }
    text.sentence((Role::Label, "Gap: "), &size(d), WIDTH, 2);
    text.sentence((Role::Label, "Place: "), &place(d), WIDTH, 2);
    text.sentence((Role::Label, "Shrink: "), &shrink(d), WIDTH, 2);
    if let Some(horizons) = by_horizon(d) {
        text.sentence((Role::Label, "Ahead: "), &horizons, WIDTH, 2);
    }
    if let Some(rest) = described(d) {
        text.sentence((Role::Doubt, "Rest: "), &format!("{rest}."), WIDTH, 2);
    }
    if let Some(own) = nuisances(d) {
        text.sentence((Role::Label, "Nuisances: "), &format!("{own}."), WIDTH, 2);
    }
    for caveat in found.caveats.iter().filter(|c| !c.comes_first()) {
        text.sentence((Role::Doubt, "Caveat: "), &format!("{caveat}."), WIDTH, 2);
    }
    if shared(d) {
        text.push(Role::Plain, "\n");
        budget(&mut text, d);
    }
    text.push(Role::Plain, "\n");
    ranking(&mut text, d, rows);
    if let Some(next) = &d.cause.next_experiment {
        text.push(Role::Plain, "\n").sentence((Role::Label, "Next: "), next, WIDTH, 2);
    }
    text
}

fn unit(p: &FoundParameter) -> String {
    if p.unit == "1" { String::new() } else { format!(" {}", p.unit) }
}

/// `delay 0.12993 s (0.12961 to 0.13022)`.
fn parameter(p: &FoundParameter) -> String {
    let Some(value) = p.value else { return format!("no {} limit", p.name) };
    match estimate(value, p.ci95) {
        (value, Some([lower, upper])) => {
            format!("{} {value}{} ({lower} to {upper})", p.name, unit(p))
        }
        (value, None) => format!("{} {value}{} (at a bound)", p.name, unit(p)),
    }
}

fn cause(d: &Diagnosis) -> String {
    let sure = format!("probability {}", percent(probability(d)));
    match (d.cause.verdict.as_str(), d.cause.effects.as_slice()) {
        ("none", _) if d.gap.before.is_none() => {
            "none could be looked for, because no output moves.".to_owned()
        }
        ("none", _) => {
            format!("none; no effect of the catalogue helps and what is left is noise ({sure}).")
        }
        ("unknown", _) if !d.cause.contributions.is_empty() => {
            format!(
                "unknown in part; what is listed below contributes, and more than noise stays ({sure})."
            )
        }
        ("unknown", _) => format!(
            "unknown; more than noise stays that no effect of the catalogue explains ({sure})."
        ),
        (_, [one]) => {
            let parameters: Vec<String> = one.parameters.iter().map(parameter).collect();
            format!(
                "{} on `{}`, {}, {sure}.",
                one.effect,
                shown(&one.channel),
                parameters.join(", ")
            )
        }
        // Their numbers stand in the budget.
        (_, several) => {
            let names: Vec<String> = several
                .iter()
                .map(|e| format!("{} on `{}`", e.effect, shown(&e.channel)))
                .collect();
            format!("{}, {sure}.", names.join(" and "))
        }
    }
}

fn rivals(d: &Diagnosis) -> String {
    if let Some(class) = d.cause.indistinguishable.first() {
        let others: Vec<String> =
            class.iter().skip(usize::from(!d.cause.effects.is_empty())).map(|n| shown(n)).collect();
        return format!("{} explain these logs as well.", others.join(", "));
    }
    let next = d.cause.ranking.iter().filter_map(|row| match row {
        RankingRow::Single(r)
            if (&r.effect, &r.channel) != (&d.cause.verdict, &d.cause.channel) =>
        {
            Some(r)
        }
        _ => None,
    });
    match next.max_by(|a, b| a.probability.total_cmp(&b.probability)) {
        Some(r) if r.effect == "unknown" && d.cause.effects.len() > 1 && r.probability > 0.01 => {
            format!(
                "another list of causes, longer or of other laws, with probability {}.",
                percent(r.probability)
            )
        }
        Some(r) if r.probability > 0.01 => {
            let channel =
                r.channel.as_deref().map(|c| format!(" on `{}`", shown(c))).unwrap_or_default();
            format!("next comes {}{channel} with probability {}.", r.effect, percent(r.probability))
        }
        _ => "none with a probability above 1 %.".to_owned(),
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
    let Some(output) = d.place.outputs.first() else {
        return "nothing stands out above the noise.".to_owned();
    };
    let mut text = format!("{} of it in `{}`", percent(output.share), shown(&output.name));
    if let Some(t) = d.place.times.iter().find(|t| t.output == output.name) {
        text += &format!(", mostly {:.2} to {:.2} s of {}", t.from_s, t.to_s, shown(&t.log));
    }
    if let Some(b) = d.place.bands.iter().find(|b| b.output == output.name) {
        text += &format!(", {:.2} to {:.2} Hz", b.from_hz, b.to_hz);
    }
    if let Some(r) = d.place.regimes.iter().find(|r| r.output == output.name) {
        text += &format!(", where {} is {:.4} to {:.4}", shown(&r.variable), r.from, r.to);
    }
    text + "."
}

fn shrink(d: &Diagnosis) -> String {
    let s = &d.shrink;
    match (s.before, s.after, s.floor, s.fraction) {
        (Some(before), Some(after), Some(floor), Some(fraction))
            if !d.cause.contributions.is_empty() =>
        {
            let decoded = s
                .decoded
                .map(|known| format!("; lost commands known, {}", percent(known)))
                .unwrap_or_default();
            let interval = s
                .ci95
                .map(|[l, u]| format!(" ({} to {})", percent(l), percent(u)))
                .unwrap_or_default();
            let [before, after, fraction, floor] = [before, after, fraction, floor].map(percent);
            format!(
                "on held-out data {before} becomes {after}, by {fraction}{interval}{decoded}; noise is {floor}."
            )
        }
        (Some(before), ..) => format!(
            "nothing was added to the model; its error on held-out data is {}.",
            percent(before)
        ),
        _ => "no held-out output moves, so nothing can be said.".to_owned(),
    }
}

/// What takes how much of the gap, and what stays.
fn budget(text: &mut Styled, d: &Diagnosis) {
    let of = |s: &Share| s.learnt;
    let mut lines: Vec<(Role, String, Option<f64>, Vec<String>)> = Vec::new();
    for c in &d.cause.contributions {
        let mut notes: Vec<String> = c.parameters.iter().map(parameter).collect();
        notes.extend(c.probability.map(|p| format!("acts with probability {}", percent(p))));
        if c.strength == Strength::Weak {
            notes.push("weak".to_owned());
        }
        if c.surrogate {
            notes.push("predicts, but is not the physics' value".to_owned());
        }
        if !c.class.is_empty() {
            notes.push(format!(
                "or {} in its place",
                c.class.iter().map(|n| shown(n)).collect::<Vec<_>>().join(" or ")
            ));
        }
        lines.push((
            Role::Counts,
            format!("{} {}", c.effect, shown(&c.channel)),
            of(&c.share),
            notes,
        ));
    }
    if let Some(r) = d.cause.recalibration.as_ref().filter(|r| r.accepted) {
        let notes = r.parameters.iter().map(parameter).collect();
        lines.push((Role::Counts, "parameters recalibrated".to_owned(), of(&r.share), notes));
    }
    if let Some(r) = &d.cause.remainder {
        let times = r.above_floor.map(|t| format!(" ({t:.1} times the noise)")).unwrap_or_default();
        lines.push((Role::Doubt, format!("what stays{times}"), of(&r.share), Vec::new()));
    }
    let known = d.shrink.decoded.is_some();
    if let Some(gained) = d.shrink.of_explainable.filter(|_| known) {
        lines.push((
            Role::Counts,
            "a simulation gains".to_owned(),
            Some(gained),
            vec!["nobody knows the sequence of a run that is still to come".to_owned()],
        ));
    }
    let name = lines
        .iter()
        .map(|l| columns(&l.1))
        .max()
        .unwrap_or(0)
        .clamp(8, WIDTH - 2 - 2 - 5 - 2 - BAR);
    let of_the_gap = if known { "of the gap, lost or late commands known" } else { "of the gap" };
    text.push(Role::Faint, format!("  {}  takes  {of_the_gap}\n", cell("cause", name, false)));
    for (role, what, share, notes) in lines {
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
    let line = |row: &RankingRow| match row {
        RankingRow::Single(r) => {
            let channel =
                r.channel.as_deref().map(|c| format!(" {}", shown(c))).unwrap_or_default();
            (format!("{}{channel}", r.effect), r.probability, r.after)
        }
        RankingRow::Pair(r) => {
            let names: Vec<String> =
                r.effects.iter().map(|[e, c]| format!("{e} {}", shown(c))).collect();
            (names.join(" + "), r.probability, r.after)
        }
    };
    let all: Vec<(String, f64, Option<f64>)> = d.cause.ranking.iter().map(line).collect();
    // Whatever is probable, and the next few of the others.
    let listed = rows.min(all.len());
    let name = all
        .iter()
        .take(listed)
        .map(|(n, ..)| columns(n))
        .max()
        .unwrap_or(0)
        .clamp(9, WIDTH - 2 - 2 - 11 - 2 - BAR - 2 - 11);
    text.push(
        Role::Faint,
        format!(
            "  {}  {}  {}  error alone\n",
            cell("candidate", name, false),
            "probability",
            " ".repeat(BAR)
        ),
    );
    for (candidate, probability, after) in all.iter().take(listed) {
        let role = if *probability < PROBABLE { Role::Faint } else { Role::Plain };
        let share = if *probability > 0.0 && *probability < PROBABLE {
            "< 1 %".to_owned()
        } else {
            percent(*probability)
        };
        let error = after.map_or_else(|| "–".to_owned(), |v| format!("{:.1} %", 100.0 * v));
        text.push(
            role,
            format!("  {}  {}  ", cell(candidate, name, false), cell(&share, 11, true)),
        );
        text.push(Role::Counts, cell(&bar(*probability, BAR), BAR, false))
            .push(role, format!("  {}\n", cell(&error, 11, true)));
    }
    let mut rest = Vec::new();
    if all.len() > listed {
        let most = all.iter().skip(listed).map(|(_, p, _)| *p).fold(0.0, f64::max);
        let bound = if most < 0.01 { "1 %".to_owned() } else { percent(most) };
        let most =
            if most < 0.01 { format!("each below {bound}") } else { format!("{bound} at most") };
        rest.push(format!("{} more candidates, {most}", all.len() - listed));
    }
    let mut reasons: Vec<(&str, usize)> = Vec::new();
    for left in &d.cause.not_tried {
        match reasons.iter_mut().find(|(why, _)| *why == left.why) {
            Some((_, count)) => *count += 1,
            None => reasons.push((&left.why, 1)),
        }
    }
    reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    rest.extend(reasons.iter().take(3).map(|(why, count)| format!("{count} not tried: {why}")));
    let others: usize = reasons.iter().skip(3).map(|(_, count)| count).sum();
    if others > 0 {
        rest.push(format!("{others} not tried for other reasons"));
    }
    if !rest.is_empty() {
        text.sentence((Role::Faint, "  "), &format!("{}.", rest.join("; ")), WIDTH, 2);
    }
}
