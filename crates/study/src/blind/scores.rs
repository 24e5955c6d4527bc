//! The list of scores: each has a name, a summary, and a measure. docs/blind.md defines them at length.

use super::judge::Judged;
use super::label::Group;

/// One score.
pub struct Definition {
    /// Its name, for reports, and for limits on them.
    pub name: &'static str,
    /// Its meaning, in a phrase.
    pub summary: &'static str,
    /// How it is measured.
    pub measure: Measure,
}

/// How a score is measured over cases.
#[derive(Clone, Copy)]
pub enum Measure {
    /// Share of the cases to which it applies, with Wilson's interval.
    Share(fn(&Judged) -> Option<bool>),
    /// Share of parameters, with Wilson's interval.
    Shares(fn(&Judged) -> &[bool]),
    /// Quantile of numbers, with a bootstrap interval over cases.
    Quantile(f64, fn(&Judged) -> Vec<f64>),
    /// Mean of numbers, with a bootstrap interval over cases.
    Mean(fn(&Judged) -> Vec<f64>),
    /// The largest number, without interval.
    Max(fn(&Judged) -> Vec<f64>),
}

/// The least probability that a logarithm is taken of.
const LEAST: f64 = 1e-6;

fn one(value: Option<f64>) -> Vec<f64> {
    value.into_iter().collect()
}

fn size(value: Option<usize>) -> Vec<f64> {
    value.map(|v| v as f64).into_iter().collect()
}

/// Whether the verdict's first word is this, for cases of one group.
fn says(case: &Judged, group: Group, word: &str) -> Option<bool> {
    (case.group == group).then(|| case.verdict == word)
}

macro_rules! scores {
    ($($name:literal $summary:literal $measure:expr;)*) => {
        &[$(Definition { name: $name, summary: $summary, measure: $measure }),*]
    };
}

/// All scores, in the order of reports.
pub const SCORES: &[Definition] = {
    use Group::{None as NoEffect, Single, Unknown};
    use Measure::{Max, Mean, Quantile, Share, Shares};
    scores! {
        "right" "all: right verdict, up to alias classes" Share(|c| Some(c.judgement.right));
        "top1" "single: effect and channel named" Share(|c| c.judgement.top1);
        "top3" "single: among the first three" Share(|c| c.judgement.top3);
        "top1_class" "single: named up to the alias class" Share(|c| c.judgement.top1_class);
        "top3_class" "single: among the first three up to the alias class" Share(|c| c.judgement.top3_class);
        "missed" "single: called none" Share(|c| says(c, Single, "none"));
        "needless_unknown" "single: called unknown" Share(|c| says(c, Single, "unknown"));
        "extra_effects" "single: more than one effect named" Share(|c| c.judgement.extra_effects);
        "class_size" "single: median size of the true alias class" Quantile(0.5, |c| size(c.judgement.class_size));
        "named_class_size" "single: median size of the class the verdict is given" Quantile(0.5, |c| size(c.judgement.named_class_size));
        "named_class_holds" "single: the truth is in that class" Share(|c| c.judgement.named_class_holds);
        "false_alarm" "none: called anything else" Share(|c| says(c, NoEffect, "none").map(|right| !right));
        "unknown_recall" "unknown: called unknown" Share(|c| says(c, Unknown, "unknown"));
        "pair_exact" "pair: both named and no other" Share(|c| c.judgement.pair_exact);
        "pair_class" "pair: the same up to alias classes" Share(|c| c.judgement.pair_class);
        "pair_any" "pair: at least one named" Share(|c| c.judgement.pair_any);
        "parameter_error" "named single: median relative error" Quantile(0.5, |c| c.judgement.parameter_errors.clone());
        "parameter_error_q90" "named single: its 90 % quantile" Quantile(0.9, |c| c.judgement.parameter_errors.clone());
        "deviation_error" "named single: median error relative to the effect's size" Quantile(0.5, |c| c.judgement.deviation_errors.clone());
        "deviation_error_q90" "named single: its 90 % quantile" Quantile(0.9, |c| c.judgement.deviation_errors.clone());
        "parameter_missing" "named single: true parameters without estimate" Shares(|c| &c.judgement.parameter_missing);
        "coverage" "named single: true parameters inside their 95 % interval" Shares(|c| &c.judgement.covered);
        "without_interval" "named single: true parameters without interval" Shares(|c| &c.judgement.without_interval);
        "where_output" "the worst output is a right one" Share(|c| c.judgement.where_output);
        "where_time" "median overlap in time (intersection over union)" Quantile(0.5, |c| one(c.judgement.where_time));
        "where_band" "median overlap in frequency" Quantile(0.5, |c| one(c.judgement.where_band));
        "strongest" "mixture: what contributes most is the strongest of the truth, up to its class" Share(|c| c.judgement.strongest);
        "recall" "mixture: mean share of the true effects that is named" Mean(|c| one(c.judgement.recall));
        "precision" "mixture: mean share of what is named that is true" Mean(|c| one(c.judgement.precision));
        "share_error" "mixture: median error of a share" Quantile(0.5, |c| c.judgement.share_errors.clone());
        "numbers" "mixture with several wrong parameters: mean F1 of the named parameters" Mean(|c| one(c.judgement.numbers));
        "false_causes" "mixture called explained: something named that is not there" Share(|c| c.judgement.false_cause);
        "mixture_of_oracle" "mixture: mean share of the oracle's shrink"
            Mean(|c| if c.group == Group::Mixture { one(c.judgement.of_oracle) } else { Vec::new() });
        "moving_class" "moving: named up to the alias class" Share(|c| c.judgement.moving_class);
        "moving_lost" "moving: dropped_commands at more than 0.5" Share(|c| c.judgement.moving_lost);
        "moving_worse" "moving: the written model is worse than nominal on held-out data" Share(|c| c.judgement.moving_worse);
        "of_oracle" "single, pair, mixture: median share of the oracle's shrink" Quantile(0.5, |c| one(c.judgement.of_oracle));
        "harm" "all: held-out error more than 2 % worse" Share(|c| c.judgement.harm);
        "log_loss" "all: mean -ln(probability of the truth)" Mean(|c| one(c.judgement.truth_probability.map(|p| -p.clamp(LEAST, 1.0).ln())));
        "time_median" "all: run time, s" Quantile(0.5, |c| one(c.judgement.time_s));
        "time_max" "all: longest run time, s" Max(|c| one(c.judgement.time_s));
    }
};

/// The names of all scores.
#[must_use]
pub(super) fn names() -> Vec<&'static str> {
    SCORES.iter().map(|d| d.name).collect()
}
