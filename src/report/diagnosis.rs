//! The diagnosis in plain sentences.

use super::text::{Table, estimate};
use deadtime_gap::{
    CheckKind, Contribution, Diagnosed, Diagnosis, FoundEffect, FoundParameter, HorizonError, Mode,
    NuisanceEstimate, RankedPair, RankingRow, Recalibration, Share, Strength,
};
use deadtime_signal::text::plus_minus;

/// First, what the checks say of signs, axes, units and clocks where one fails: no dynamics has to be named for what a remedy at the log or the model settles.
/// Five sentences: how big the gap is, where it sits, what causes it and how sure that is, what else it could be, how far it shrinks; and one more where
/// several effects contribute or something stays: how much each takes. What stays is described in a sentence of its own where that is more than chance, and so
/// are the nuisances that the model file declares.
#[must_use]
pub fn summary(found: &Diagnosed) -> String {
    let d = &found.diagnosis;
    let rest = described(d).map(|sentence| format!("Rest: {sentence}."));
    let own = nuisances(d).map(|each| format!("Nuisances: {each}."));
    let lines = [
        first(found),
        Some(size(d)),
        Some(place(d)),
        Some(cause(d)),
        budget(d),
        rest,
        own,
        Some(rivals(d)),
        Some(shrink(d)),
    ];
    lines.into_iter().flatten().collect::<Vec<_>>().join("\n")
}

pub(super) fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

/// What has to be settled before the rest: the findings of checks that have a remedy, and what speaks against the model as it came.
pub(super) fn first(found: &Diagnosed) -> Option<String> {
    use CheckKind::{Axes, ClockOffset, ClockSkew, Sign, Unit};
    let failed = found.diagnosis.checks.iter();
    let failed = failed.filter(|c| {
        c.ok == Some(false) && matches!(c.check, Sign | Axes | Unit | ClockOffset | ClockSkew)
    });
    let of_model = found.caveats.iter().filter(|c| c.comes_first()).map(ToString::to_string);
    let findings: Vec<String> =
        failed.map(|c| c.finding.trim_end_matches('.').to_owned()).chain(of_model).collect();
    (!findings.is_empty())
        .then(|| format!("First: {}. Mend that before the rest is believed.", findings.join("; ")))
}

fn size(d: &Diagnosis) -> String {
    let mode = match d.prediction.mode {
        Mode::Simulation | Mode::Horizon => d.prediction.words(),
        Mode::Predictor => "predicted one step ahead by a fixed observer",
    };
    match (d.gap.before, d.gap.floor) {
        (Some(before), Some(floor)) => format!(
            "Gap: the model {} ({mode}: {}) misses the logs by {} of their spread; the noise floor is {}.",
            d.model,
            d.prediction.why,
            percent(before),
            percent(floor)
        ),
        _ => format!(
            "Gap: every output of {} stands still in the logs, so there is nothing to compare.",
            d.model
        ),
    }
}

fn place(d: &Diagnosis) -> String {
    let Some(output) = d.place.outputs.first() else {
        return "Place: nothing stands out above the noise.".to_owned();
    };
    let time = d.place.times.iter().find(|t| t.output == output.name);
    let band = d.place.bands.iter().find(|b| b.output == output.name);
    let mut text = format!("Place: {} of it is in `{}`", percent(output.share), output.name);
    if let Some(t) = time {
        text += &format!(", mostly between {:.3} s and {:.3} s of {}", t.from_s, t.to_s, t.log);
    }
    if let Some(b) = band {
        text += &format!(", from {:.3} Hz to {:.3} Hz", b.from_hz, b.to_hz);
    }
    if let Some(r) = d.place.regimes.iter().find(|r| r.output == output.name) {
        text += &format!(", where {} lies between {:.4} and {:.4}", r.variable, r.from, r.to);
    }
    text + "."
}

fn parameter(p: &FoundParameter) -> String {
    let unit = if p.unit == "1" { String::new() } else { format!(" {}", p.unit) };
    let Some(value) = p.value else { return format!("no {} limit", p.name) };
    match estimate(value, p.ci95) {
        (value, Some([lower, upper])) => {
            format!("{} = {value}{unit} (95 %: {lower} to {upper})", p.name)
        }
        (value, None) => format!("{} = {value}{unit} (at a bound)", p.name),
    }
}

fn effect(e: &FoundEffect) -> String {
    let parameters: Vec<String> = e.parameters.iter().map(parameter).collect();
    format!("{} on `{}` with {}", e.effect, e.channel, parameters.join(", "))
}

/// Whether a row of the ranking is what was found, in either order.
pub(super) fn same_pair(row: &RankedPair, found: &[FoundEffect]) -> bool {
    let holds = |e: &FoundEffect| {
        row.effects.iter().any(|[effect, channel]| *effect == e.effect && *channel == e.channel)
    };
    row.effects.len() == found.len() && found.iter().all(holds)
}

/// Several share the gap, or something stays: a single effect that explains all needs no budget.
pub(super) fn shared(d: &Diagnosis) -> bool {
    let contributions = &d.cause.contributions;
    let weak = contributions.iter().any(|c| c.strength == Strength::Weak);
    let block = recalibrated(d).is_some();
    let alone = contributions.len() == 1 && !d.cause.effects.is_empty() && !weak;
    block || (!contributions.is_empty() && !alone)
}

/// The model's own numbers, where they were freed as a block.
pub(super) fn recalibrated(d: &Diagnosis) -> Option<&Recalibration> {
    d.cause.recalibration.as_ref().filter(|r| r.accepted)
}

/// How much each contribution takes, and what stays; `None` where a single effect explains all.
fn budget(d: &Diagnosis) -> Option<String> {
    if !shared(d) {
        return None;
    }
    let share = |share: &Share| {
        let each =
            [(share.learnt, "of what was learnt from"), (share.held_out, "of held-out data")];
        let each: Vec<String> =
            each.into_iter().filter_map(|(s, of)| Some(format!("{} {of}", percent(s?)))).collect();
        if each.is_empty() { "a part that cannot be told".to_owned() } else { each.join(" and ") }
    };
    let one = |c: &Contribution| {
        let found = FoundEffect {
            effect: c.effect.clone(),
            channel: c.channel.clone(),
            parameters: c.parameters.clone(),
        };
        let class = if c.class.is_empty() {
            String::new()
        } else {
            format!(", or {} in its place", c.class.join(" or "))
        };
        let surrogate =
            if c.surrogate { ", whose value predicts but is not the physics'" } else { "" };
        let weak = if c.strength == Strength::Weak { ", weak" } else { "" };
        let acts = c
            .probability
            .map(|p| format!(", acts with probability {} and", percent(p)))
            .unwrap_or_default();
        format!("{}{class}{surrogate}{weak}{acts} takes {}", effect(&found), share(&c.share))
    };
    let stays = d.cause.remainder.as_ref().filter(|r| r.share.learnt.is_some()).map(|r| {
        let times =
            r.above_floor.map(|t| format!(", {t:.1} times the noise floor")).unwrap_or_default();
        format!("; {} stays{times}", share(&r.share))
    });
    let numbers = |r: &Recalibration| {
        let value = |p: &FoundParameter| {
            format!(
                "{} = {}",
                p.name,
                p.value.map_or_else(|| "–".to_owned(), |v| estimate(v, p.ci95).0)
            )
        };
        let each: Vec<String> = r.parameters.iter().map(value).collect();
        let alike = if r.directions.is_empty() {
            String::new()
        } else {
            format!(", {}", r.directions.join(", "))
        };
        format!("the model's own numbers ({}{alike}) take {}", each.join(", "), share(&r.share))
    };
    let all: Vec<String> =
        d.cause.contributions.iter().map(one).chain(recalibrated(d).map(numbers)).collect();
    let (known, gains) = match (d.shrink.decoded, d.shrink.of_explainable) {
        (Some(_), gained) => {
            let gains = gained.map(|g| {
                format!(
                    "; a simulation, which cannot know it, gains {} of held-out data",
                    percent(g)
                )
            });
            ("once it is known which commands were lost or late, ", gains.unwrap_or_default())
        }
        (None, _) => ("", String::new()),
    };
    Some(format!("Budget: {known}{}{}{gains}.", all.join("; "), stays.unwrap_or_default()))
}

/// What stays, as a missing force.
pub(super) fn described(d: &Diagnosis) -> Option<&str> {
    Some(d.cause.remainder.as_ref()?.description.as_ref()?.sentence.as_str())
}

/// What every log has of its own, as `input_offset:u = 1.30 ± 0.21 V in a.csv, …`; `None` without nuisances.
pub(super) fn nuisances(d: &Diagnosis) -> Option<String> {
    let one = |(at, n): (usize, &NuisanceEstimate)| {
        let unit = if n.unit == "1" { String::new() } else { format!(" {}", n.unit) };
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
        format!("{apart}{name}{}{unit} in {}", plus_minus(n.value, n.std), n.log)
    };
    (!d.nuisances.is_empty()).then(|| d.nuisances.iter().enumerate().map(one).collect())
}

/// The probability of the verdict.
pub(super) fn probability(d: &Diagnosis) -> f64 {
    let of = |row: &RankingRow| match row {
        RankingRow::Single(r)
            if d.cause.effects.len() < 2
                && r.effect == d.cause.verdict
                && r.channel == d.cause.channel =>
        {
            Some(r.probability)
        }
        RankingRow::Pair(r) if same_pair(r, &d.cause.effects) => Some(r.probability),
        _ => None,
    };
    d.cause.ranking.iter().find_map(of).unwrap_or(0.0)
}

fn cause(d: &Diagnosis) -> String {
    let sure = percent(probability(d));
    match d.cause.verdict.as_str() {
        "none" if d.gap.before.is_none() => {
            "Cause: none could be looked for, because no output moves.".to_owned()
        }
        "none" => format!(
            "Cause: none; no effect of the catalogue helps and what is left is noise (probability {sure})."
        ),
        "unknown" if !d.cause.contributions.is_empty() => format!(
            "Cause: unknown in part; what is listed next contributes, and a gap above the noise stays that no effect of the catalogue explains \
             (probability {sure})."
        ),
        "unknown" => format!(
            "Cause: unknown; a gap above the noise stays that no effect of the catalogue explains (probability {sure})."
        ),
        _ => format!(
            "Cause: {} (probability {sure}).",
            d.cause.effects.iter().map(effect).collect::<Vec<_>>().join(" and ")
        ),
    }
}

fn rivals(d: &Diagnosis) -> String {
    if let Some(class) = d.cause.indistinguishable.first() {
        let others: Vec<&str> = class
            .iter()
            .skip(usize::from(!d.cause.effects.is_empty()))
            .map(String::as_str)
            .collect();
        let next = d.cause.next_experiment.as_deref().map(|n| format!(" {n}")).unwrap_or_default();
        return format!("Rivals: this data cannot tell it from {}.{next}", others.join(", "));
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
                "Rivals: another list of causes, longer or of other laws, with probability {}.",
                percent(r.probability)
            )
        }
        Some(r) if r.probability > 0.01 => {
            let channel = r.channel.as_deref().map(|c| format!(" on `{c}`")).unwrap_or_default();
            format!(
                "Rivals: next comes {}{channel} with probability {}.",
                r.effect,
                percent(r.probability)
            )
        }
        _ => "Rivals: none with a probability above 1 %.".to_owned(),
    }
}

fn shrink(d: &Diagnosis) -> String {
    let s = &d.shrink;
    match (s.before, s.after, s.floor, s.fraction) {
        (Some(before), Some(after), Some(floor), Some(fraction))
            if !d.cause.contributions.is_empty() =>
        {
            let decoded = s.decoded.map(|known| {
                format!(
                    "; once it is known which commands were lost or late, to {}",
                    percent(known)
                )
            });
            let interval = s
                .ci95
                .map(|[l, u]| format!(" (95 %: {} to {})", percent(l), percent(u)))
                .unwrap_or_default();
            format!(
                "Shrink: on held-out data the error falls from {} to {} of the spread, by {}{interval}{}; the floor there is {}.{}",
                percent(before),
                percent(after),
                percent(fraction),
                decoded.unwrap_or_default(),
                percent(floor),
                by_horizon(d).map(|text| format!(" By horizon: {text}")).unwrap_or_default()
            )
        }
        (Some(before), ..) => {
            format!(
                "Shrink: nothing was added to the model; on held-out data its error is {} of the spread.",
                percent(before)
            )
        }
        _ => "Shrink: no held-out output moves, so nothing can be said.".to_owned(),
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
        let (effect, channel, probability, after) = match row {
            RankingRow::Single(r) => {
                (r.effect.clone(), r.channel.clone().unwrap_or_default(), r.probability, r.after)
            }
            RankingRow::Pair(r) => {
                let join = |i: usize| {
                    r.effects.iter().map(|e| e[i].as_str()).collect::<Vec<_>>().join(" + ")
                };
                (join(0), join(1), r.probability, r.after)
            }
        };
        table.row(vec![
            effect,
            channel,
            format!("{probability:.4}"),
            after.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}")),
        ]);
    }
    table
}
