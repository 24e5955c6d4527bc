//! A diagnosis for a terminal.

use super::axis::share as bar;
use crate::report::diagnosis::{
    Line, aliases, caveat_lines, lines, percent, sure, values, verdict as answer,
};
use crate::report::facts::{Label, recalibrated};
use crate::report::styled::{Role, Styled, WIDTH, cell, columns};
use deadtime_gap::{CauseClass, Contribution, Diagnosed, Diagnosis, Strength};

/// Cells of a bar.
const BAR: usize = 20;

/// A sentence behind its label.
fn line(text: &mut Styled, Line { label, text: sentence }: &Line) {
    let role = match label {
        Label::Cause => Role::Strong,
        Label::First | Label::Left | Label::Caveat => Role::Doubt,
        _ => Role::Label,
    };
    text.sentence((role, &format!("{}: ", label.word())), sentence, WIDTH, 2);
}

/// The answer alone: the cause, and how far the error falls with it.
#[must_use]
pub fn verdict(d: &Diagnosis) -> Styled {
    let mut text = Styled::default();
    answer(d).iter().for_each(|l| line(&mut text, l));
    text
}

/// The first fix, the cause, the reduction on held-out data, the residual, the next experiment; no table.
#[must_use]
pub fn short_diagnosis(found: &Diagnosed) -> Styled {
    let mut text = Styled::default();
    lines(found).iter().take_while(|l| l.label != Label::Gap).for_each(|l| line(&mut text, l));
    text
}

/// The answer, size and place of the gap, and the causes with their shares. No line is wider than 80 columns.
#[must_use]
pub fn diagnosis(found: &Diagnosed) -> Styled {
    let d = &found.diagnosis;
    let mut text = Styled::default();
    lines(found).iter().chain(&caveat_lines(found)).for_each(|l| line(&mut text, l));
    if !d.cause.classes.is_empty() {
        text.push(Role::Plain, "\n");
        causes(&mut text, d);
    }
    let rest: Vec<String> = tried(d).into_iter().chain(not_tried(d)).collect();
    if !rest.is_empty() {
        text.push(Role::Plain, "\n");
        text.sentence((Role::Faint, "  "), &format!("{}.", rest.join("; ")), WIDTH, 2);
    }
    text
}

/// The text below a class: values, and further facts about it.
fn notes(d: &Diagnosis, class: &CauseClass) -> Vec<String> {
    let own = |c: &&Contribution| class.representative == format!("{}:{}", c.effect, c.channel);
    let mut notes = Vec::new();
    if let Some(c) = d.cause.contributions.iter().find(own) {
        notes.push(values(&c.parameters));
        if c.surrogate {
            notes.push("it predicts, but its value is not physical".to_owned());
        }
    } else if let Some(r) = recalibrated(d) {
        notes.push(values(&r.parameters));
    }
    if class.strength == Strength::Weak {
        notes.push("weak".to_owned());
    }
    notes.extend(aliases(class).map(|others| format!("or {others}")));
    notes
}

/// Every class of causes with its share of the gap and its probability, then the residual.
fn causes(text: &mut Styled, d: &Diagnosis) {
    let classes = &d.cause.classes;
    let longest = classes.iter().map(|c| columns(&c.name)).max().unwrap_or(0);
    let name = longest.clamp(8, WIDTH - 2 - 2 - 8 - 2 - 9 - 2 - BAR);
    let known = d.shrink.decoded.is_some();
    let of_the_gap = if known { "of the gap, lost or late commands known" } else { "of the gap" };
    let head = format!("  {}  explains       sure  {of_the_gap}\n", cell("cause", name, false));
    text.push(Role::Faint, head);
    let mut row = |role, what: &str, share: Option<f64>, sure: &str, notes: &[String]| {
        let explains = share.map_or_else(|| "–".to_owned(), percent);
        let cells = [cell(what, name, false), cell(&explains, 8, true), cell(sure, 9, true)];
        let drawn = share.map(|s| bar(s, BAR)).unwrap_or_default();
        let row = format!("  {}  ", cells.join("  "));
        text.push(Role::Plain, if drawn.is_empty() { row.trim_end() } else { &row });
        text.push(role, drawn).push(Role::Plain, "\n");
        if !notes.is_empty() {
            text.sentence((Role::Plain, "    "), &notes.join("; "), WIDTH, 4);
        }
    };
    for class in classes {
        let sure = sure(class.probability);
        row(Role::Counts, &class.name, class.share.learnt, &sure, &notes(d, class));
    }
    if let Some(left) = &d.cause.remainder {
        row(Role::Doubt, "residual", left.share.learnt, "", &[]);
    }
    if let Some(gained) = d.shrink.of_explainable.filter(|_| known) {
        let why = ["nobody knows the lost commands of a run that is still to come".to_owned()];
        row(Role::Counts, "a simulation gains", Some(gained), "", &why);
    }
}

/// The number of tried candidates.
fn tried(d: &Diagnosis) -> Option<String> {
    let count = d.cause.ranking.len().saturating_sub(2);
    (count > 0).then(|| format!("{count} candidates tried"))
}

/// The number of untried candidates, by reason.
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
    let mut listed: Vec<String> =
        named.iter().map(|(why, count)| format!("{count} not tried: {why}")).collect();
    let others: usize = others.iter().map(|(_, count)| count).sum();
    if others > 0 {
        listed.push(format!("{others} not tried for other reasons"));
    }
    listed
}
