//! The diagnosis in plain sentences.

use super::facts::{
    Cause, Label, Place, Ranked, Rivals, Shrink, caveats, described, first, probability,
    recalibrated, shared,
};
use super::text::{Table, estimate, unit};
use deadtime_gap::{
    Contribution, Diagnosed, Diagnosis, FoundEffect, FoundParameter, HorizonError, Mode,
    NuisanceEstimate, Recalibration, Share, Strength,
};
use deadtime_signal::text::plus_minus;

/// A line of the summary.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// What it is about.
    pub label: Label,
    /// Its sentence.
    pub text: String,
}

/// First, the findings of checks of signs, axes, units and clocks that failed: their remedy at the log or the model changes all that follows.
/// Then the size of the gap, its place, its cause with its probability, competing hypotheses, and the reduction on held-out data.
/// Several causes have a budget of shares, a remainder its description, nuisances of the model file their values.
#[must_use]
pub fn lines(found: &Diagnosed) -> Vec<Line> {
    let d = &found.diagnosis;
    let before = first(found);
    let before = (!before.is_empty())
        .then(|| format!("{}. Mend that before the rest is believed.", before.join("; ")));
    let all = [
        (Label::First, before),
        (Label::Gap, Some(size(d))),
        (Label::Place, Some(place(d))),
        (Label::Cause, Some(cause(d))),
        (Label::Budget, shared(d).then(|| budget(d))),
        (Label::Rest, described(d).map(|sentence| format!("{sentence}."))),
        (Label::Nuisances, nuisances(d).map(|each| format!("{each}."))),
        (Label::Rivals, Some(rivals(d))),
        (Label::Shrink, Some(shrink(d))),
    ];
    all.into_iter().filter_map(|(label, text)| Some(Line { label, text: text? })).collect()
}

/// The caveats, a line each.
#[must_use]
pub fn caveat_lines(found: &Diagnosed) -> Vec<Line> {
    caveats(found).map(|text| Line { label: Label::Caveat, text: format!("{text}.") }).collect()
}

/// The lines of the summary as text.
#[must_use]
pub fn summary(found: &Diagnosed) -> String {
    lines(found).iter().map(Line::to_string).collect::<Vec<_>>().join("\n")
}

impl std::fmt::Display for Line {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.label.word(), self.text)
    }
}

pub(super) fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn size(d: &Diagnosis) -> String {
    let mode = match d.prediction.mode {
        Mode::Simulation | Mode::Horizon => d.prediction.words(),
        Mode::Predictor => "predicted one step ahead by a fixed observer",
    };
    match (d.gap.before, d.gap.floor) {
        (Some(before), Some(floor)) => format!(
            "the model {} ({mode}: {}) misses the logs by {} of their spread; the noise floor is {}.",
            d.model,
            d.prediction.why,
            percent(before),
            percent(floor)
        ),
        _ => format!(
            "every output of {} stands still in the logs, so there is nothing to compare.",
            d.model
        ),
    }
}

fn place(d: &Diagnosis) -> String {
    let Some(Place { output, time, band, regime }) = Place::of(d) else {
        return "nothing stands out above the noise.".to_owned();
    };
    let mut text = format!("{} of it is in `{}`", percent(output.share), output.name);
    if let Some(t) = time {
        text += &format!(", mostly between {:.3} s and {:.3} s of {}", t.from_s, t.to_s, t.log);
    }
    if let Some(b) = band {
        text += &format!(", from {:.3} Hz to {:.3} Hz", b.from_hz, b.to_hz);
    }
    if let Some(r) = regime {
        text += &format!(", where {} lies between {:.4} and {:.4}", r.variable, r.from, r.to);
    }
    text + "."
}

fn parameter(p: &FoundParameter) -> String {
    let unit = unit(&p.unit);
    let Some(value) = p.value else { return format!("no {} limit", p.name) };
    match estimate(value, p.ci95) {
        (value, Some([lower, upper])) => {
            format!("{} = {value}{unit} (95 %: {lower} to {upper})", p.name)
        }
        (value, None) => format!("{} = {value}{unit} (at a bound)", p.name),
    }
}

fn effect(effect: &str, channel: &str, parameters: &[FoundParameter]) -> String {
    let parameters: Vec<String> = parameters.iter().map(parameter).collect();
    format!("{effect} on `{channel}` with {}", parameters.join(", "))
}

/// The share of the gap that a cause takes, on both parts of the data.
fn takes(share: &Share) -> String {
    let each = [(share.learnt, "of what was learnt from"), (share.held_out, "of held-out data")];
    let each: Vec<String> =
        each.into_iter().filter_map(|(s, of)| Some(format!("{} {of}", percent(s?)))).collect();
    if each.is_empty() { "a part that cannot be told".to_owned() } else { each.join(" and ") }
}

/// One effect of several.
fn contribution(c: &Contribution) -> String {
    let mut text = effect(&c.effect, &c.channel, &c.parameters);
    if !c.class.is_empty() {
        text += &format!(", or {} in its place", c.class.join(" or "));
    }
    if c.surrogate {
        text += ", whose value predicts but is not the physics'";
    }
    if c.strength == Strength::Weak {
        text += ", weak";
    }
    if let Some(p) = c.probability {
        text += &format!(", acts with probability {} and", percent(p));
    }
    format!("{text} takes {}", takes(&c.share))
}

/// The model's own parameters together.
fn recalibration(r: &Recalibration) -> String {
    let value = |p: &FoundParameter| {
        let value = p.value.map_or_else(|| "–".to_owned(), |v| estimate(v, p.ci95).0);
        format!("{} = {value}", p.name)
    };
    let mut each = r.parameters.iter().map(value).collect::<Vec<_>>().join(", ");
    if !r.directions.is_empty() {
        each += &format!(", {}", r.directions.join(", "));
    }
    format!("the model's own numbers ({each}) take {}", takes(&r.share))
}

/// How much each contribution takes, and the remainder.
fn budget(d: &Diagnosis) -> String {
    let causes = d.cause.contributions.iter().map(contribution);
    let all: Vec<String> = causes.chain(recalibrated(d).map(recalibration)).collect();
    let mut text = all.join("; ");
    if let Some(r) = d.cause.remainder.as_ref().filter(|r| r.share.learnt.is_some()) {
        text += &format!("; {} stays", takes(&r.share));
        if let Some(times) = r.above_floor {
            text += &format!(", {times:.1} times the noise floor");
        }
    }
    if d.shrink.decoded.is_none() {
        return text + ".";
    }
    if let Some(gained) = d.shrink.of_explainable {
        text += &format!(
            "; a simulation, which cannot know it, gains {} of held-out data",
            percent(gained)
        );
    }
    format!("once it is known which commands were lost or late, {text}.")
}

/// What every log has of its own, as `input_offset:u = 1.30 ± 0.21 V in a.csv, …`; `None` without nuisances.
pub(super) fn nuisances(d: &Diagnosis) -> Option<String> {
    let one = |(at, n): (usize, &NuisanceEstimate)| {
        let same =
            |before: &NuisanceEstimate| before.effect == n.effect && before.channel == n.channel;
        let begins = at == 0 || !d.nuisances.get(at - 1).is_some_and(same);
        let name = if begins { format!("{}:{} = ", n.effect, n.channel) } else { String::new() };
        let apart = if at == 0 {
            ""
        } else if begins {
            "; "
        } else {
            ", "
        };
        format!("{apart}{name}{}{} in {}", plus_minus(n.value, n.std), unit(&n.unit), n.log)
    };
    (!d.nuisances.is_empty()).then(|| d.nuisances.iter().enumerate().map(one).collect())
}

fn cause(d: &Diagnosis) -> String {
    let sure = percent(probability(d));
    let all = |effects: &[FoundEffect]| {
        let each: Vec<String> =
            effects.iter().map(|e| effect(&e.effect, &e.channel, &e.parameters)).collect();
        each.join(" and ")
    };
    match Cause::of(d) {
        Cause::NothingMoves => "none could be looked for, because no output moves.".to_owned(),
        Cause::None => format!(
            "none; no effect of the catalogue helps and what is left is noise (probability {sure})."
        ),
        Cause::UnknownInPart => format!(
            "unknown in part; what is listed next contributes, and a gap above the noise stays that no effect of the catalogue explains \
             (probability {sure})."
        ),
        Cause::Unknown => format!(
            "unknown; a gap above the noise stays that no effect of the catalogue explains (probability {sure})."
        ),
        Cause::Effects(effects) => format!("{} (probability {sure}).", all(effects)),
    }
}

fn rivals(d: &Diagnosis) -> String {
    match Rivals::of(d) {
        Rivals::Class(others) => {
            let next = d.cause.next_experiment.as_deref();
            let next = next.map(|n| format!(" {n}")).unwrap_or_default();
            format!("this data cannot tell it from {}.{next}", others.join(", "))
        }
        Rivals::AnotherList(p) => format!(
            "another list of causes, longer or of other laws, with probability {}.",
            percent(p)
        ),
        Rivals::Next(r) => {
            let channel = r.channel.as_deref().map(|c| format!(" on `{c}`")).unwrap_or_default();
            format!("next comes {}{channel} with probability {}.", r.effect, percent(r.probability))
        }
        Rivals::Improbable => "none with a probability above 1 %.".to_owned(),
    }
}

fn shrink(d: &Diagnosis) -> String {
    match Shrink::of(d) {
        Shrink::Falls { before, after, floor, fraction } => {
            let decoded = d.shrink.decoded.map(|known| {
                format!(
                    "; once it is known which commands were lost or late, to {}",
                    percent(known)
                )
            });
            let interval = d
                .shrink
                .ci95
                .map(|[l, u]| format!(" (95 %: {} to {})", percent(l), percent(u)))
                .unwrap_or_default();
            format!(
                "on held-out data the error falls from {} to {} of the spread, by {}{interval}{}; the floor there is {}.{}",
                percent(before),
                percent(after),
                percent(fraction),
                decoded.unwrap_or_default(),
                percent(floor),
                by_horizon(d).map(|text| format!(" By horizon: {text}")).unwrap_or_default()
            )
        }
        Shrink::NothingAdded { before } => format!(
            "nothing was added to the model; on held-out data its error is {} of the spread.",
            percent(before)
        ),
        Shrink::NothingMoves => "no held-out output moves, so nothing can be said.".to_owned(),
    }
}

/// How the error grows ahead, before and after; `None` where predictions have no horizon.
pub(super) fn by_horizon(d: &Diagnosis) -> Option<String> {
    let one = |h: &HorizonError| {
        Some(format!(
            "{} sample{} ahead from {} to {}",
            h.samples,
            if h.samples == 1 { "" } else { "s" },
            part(h.before?),
            part(h.after?)
        ))
    };
    let all: Vec<String> = d.shrink.horizons.iter().filter_map(one).collect();
    (!all.is_empty()).then(|| format!("{}.", all.join(", ")))
}

/// A share of a few percent needs a digit more.
fn part(share: f64) -> String {
    if share < 0.1 { format!("{:.1} %", 100.0 * share) } else { percent(share) }
}

/// The leading rows of the ranking.
#[must_use]
pub fn ranking(d: &Diagnosis, rows: usize) -> Table {
    let mut table = Table::new(&["effect", "channel", "probability", "nrmse alone"], &[0, 1]);
    for row in d.cause.ranking.iter().take(rows) {
        let row = Ranked::of(row);
        let [effect, channel] = row.cells();
        table.row(vec![
            effect,
            channel,
            format!("{:.4}", row.probability),
            row.after.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}")),
        ]);
    }
    table
}
