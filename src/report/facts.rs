//! The facts of a diagnosis, line by line, as values. Each output format writes its own words from them.

use deadtime_gap::{
    Band, CheckKind, Diagnosed, Diagnosis, Explained, FoundEffect, RankedPair, RankingRow,
    Recalibration, Regime, TimeSpan, WhereOutput,
};

/// A label of the summary.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Label {
    /// The first fix.
    First,
    /// The size of the gap.
    Gap,
    /// Its place.
    Place,
    /// Its cause.
    Cause,
    /// The reduction on held-out data.
    Shrink,
    /// The residual.
    Left,
    /// The nuisances of every log.
    Nuisances,
    /// A caveat.
    Caveat,
    /// The next experiment.
    Next,
}

impl Label {
    /// The word that a face prints.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::First => "First",
            Self::Gap => "Gap",
            Self::Place => "Place",
            Self::Cause => "Cause",
            Self::Left => "Left",
            Self::Nuisances => "Nuisances",
            Self::Shrink => "Shrink",
            Self::Caveat => "Caveat",
            Self::Next => "Next",
        }
    }
}

/// The verdict.
pub(super) enum Cause<'a> {
    NothingMoves,
    None,
    Mostly,
    Part,
    Unknown,
    Effects(&'a [FoundEffect]),
}

impl<'a> Cause<'a> {
    pub(super) fn of(d: &'a Diagnosis) -> Self {
        match d.cause.verdict.as_str() {
            "none" if d.gap.before.is_none() => Self::NothingMoves,
            "none" => Self::None,
            "unknown" if d.cause.explained == Some(Explained::Mostly) => Self::Mostly,
            "unknown" if acts(d) => Self::Part,
            "unknown" => Self::Unknown,
            _ => Self::Effects(&d.cause.effects),
        }
    }
}

/// The error on held-out data.
pub(super) enum Shrink {
    /// From `before` to `after`, a fraction of it.
    Falls { before: f64, after: f64, floor: f64, fraction: f64 },
    /// Nothing was added to the model.
    NothingAdded { before: f64 },
    /// The causes do not lower the error, so the written model is the one that came.
    NotConfirmed { before: f64 },
    /// No held-out output moves.
    NothingMoves,
}

impl Shrink {
    pub(super) fn of(d: &Diagnosis) -> Self {
        let s = &d.shrink;
        match (s.before, s.after, s.floor, s.fraction) {
            (Some(before), Some(after), ..) if before == after && acts(d) => {
                Self::NotConfirmed { before }
            }
            (Some(before), Some(after), Some(floor), Some(fraction)) if acts(d) => {
                Self::Falls { before, after, floor, fraction }
            }
            (Some(before), ..) => Self::NothingAdded { before },
            _ => Self::NothingMoves,
        }
    }
}

/// The output with most of the gap, and where in it the gap is.
pub(super) struct Place<'a> {
    pub(super) output: &'a WhereOutput,
    pub(super) time: Option<&'a TimeSpan>,
    pub(super) band: Option<&'a Band>,
    pub(super) regime: Option<&'a Regime>,
}

impl<'a> Place<'a> {
    /// `None` where nothing is above the noise.
    pub(super) fn of(d: &'a Diagnosis) -> Option<Self> {
        let output = d.place.outputs.first()?;
        Some(Self {
            output,
            time: d.place.times.iter().find(|t| t.output == output.name),
            band: d.place.bands.iter().find(|b| b.output == output.name),
            regime: d.place.regimes.iter().find(|r| r.output == output.name),
        })
    }
}

/// A row of the ranking.
pub(super) struct Ranked<'a> {
    /// Effect and channel of each; the channel is empty for `none` and `unknown`.
    pub(super) effects: Vec<[&'a str; 2]>,
    pub(super) probability: f64,
    /// The training nrmse with it alone.
    pub(super) after: Option<f64>,
}

impl<'a> Ranked<'a> {
    pub(super) fn of(row: &'a RankingRow) -> Self {
        match row {
            RankingRow::Single(r) => Self {
                effects: vec![[&r.effect, r.channel.as_deref().unwrap_or_default()]],
                probability: r.probability,
                after: r.after,
            },
            RankingRow::Pair(r) => Self {
                effects: r.effects.iter().map(|[effect, channel]| [&**effect, channel]).collect(),
                probability: r.probability,
                after: r.after,
            },
        }
    }

    /// All effects, and all channels, as cells of a table.
    pub(super) fn cells(&self) -> [String; 2] {
        [0, 1].map(|i| self.effects.iter().map(|e| e[i]).collect::<Vec<_>>().join(" + "))
    }
}

/// The first fixes: the findings of checks with a remedy, and the evidence against the nominal model.
pub(super) fn first(found: &Diagnosed) -> Vec<String> {
    use CheckKind::{Axes, ClockOffset, ClockSkew, Sign, Unit};
    let failed = found.diagnosis.checks.iter().filter(|c| {
        c.ok == Some(false) && matches!(c.check, Sign | Axes | Unit | ClockOffset | ClockSkew)
    });
    let of_model = found.caveats.iter().filter(|c| c.comes_first()).map(ToString::to_string);
    failed.map(|c| c.finding.trim_end_matches('.').to_owned()).chain(of_model).collect()
}

/// The caveats that do not come first.
pub(super) fn caveats(found: &Diagnosed) -> impl Iterator<Item = String> {
    found.caveats.iter().filter(|c| !c.comes_first()).map(ToString::to_string)
}

/// Whether a row of the ranking is the found pair, in either order.
fn same_pair(row: &RankedPair, found: &[FoundEffect]) -> bool {
    let holds = |e: &FoundEffect| {
        row.effects.iter().any(|[effect, channel]| *effect == e.effect && *channel == e.channel)
    };
    row.effects.len() == found.len() && found.iter().all(holds)
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

/// The recalibration of the model's own parameters, where it is part of the answer.
pub(super) fn recalibrated(d: &Diagnosis) -> Option<&Recalibration> {
    d.cause.recalibration.as_ref().filter(|r| r.accepted)
}

/// Whether something was found to act: a cause of its own, or the recalibrated parameters.
pub(super) fn acts(d: &Diagnosis) -> bool {
    !d.cause.contributions.is_empty() || recalibrated(d).is_some()
}

/// The remainder as a missing force.
pub(super) fn described(d: &Diagnosis) -> Option<&str> {
    Some(&d.cause.remainder.as_ref()?.description.as_ref()?.sentence)
}
