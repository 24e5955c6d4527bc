//! Estimates for people (a table and a sentence) and for machines (`deadtime/estimate@1`).

use std::fmt::Write;

use super::log::number;
use super::standing::{Standing, reason};
use super::text::{Table, delay, delay_cells, deviation, seconds};
use deadtime_delay::report::{Bias, Estimate, Pair, Report, Searched};
use deadtime_delay::track::Tracked;
use deadtime_delay::{DelayQuantile, Jitter};

/// The durations of single events: `Of 400 events 50 % take 0.128 s or less (0.124 to 0.132 s), …`.
pub(super) fn single_events(jitter: &Jitter, step_s: f64) -> String {
    let one = |q: &DelayQuantile| {
        let percent = (100.0 * q.share).round();
        let (value, ends) = match q.ci95_s {
            [Some(low), Some(high)] => {
                let (value, ends) = delay(q.delay_s, Some([low, high]), step_s);
                // The interval of a quantile need not be even about it.
                let ends = ends.map_or_else(String::new, |_| {
                    format!("{} to {} s", seconds(low, step_s), seconds(high, step_s))
                });
                (value, ends)
            }
            [Some(low), None] => {
                (seconds(q.delay_s, step_s), format!("{} s or more", seconds(low, step_s)))
            }
            [None, Some(high)] => {
                (seconds(q.delay_s, step_s), format!("{} s or less", seconds(high, step_s)))
            }
            [None, None] => {
                (seconds(q.delay_s, step_s), "too few events for an interval".to_owned())
            }
        };
        format!("{percent} % take {value} s or less ({ends})")
    };
    let quantiles: Vec<String> = jitter.quantiles.iter().map(one).collect();
    let seen = jitter.longest_s.map_or_else(String::new, |longest| {
        format!(
            "; some were missed, and a delay above {} s could not be seen",
            seconds(longest, step_s)
        )
    });
    format!("Of {} events {}{seen}", jitter.events, quantiles.join(", "))
}

/// A sentence on the search and its assumptions.
#[must_use]
pub fn preamble(report: &Report) -> String {
    let (name, until) = (&report.log, report.max_delay_s);
    match &report.searched {
        Searched::Samples { samples, records, bias, early_s } => {
            let records =
                if *records > 1 { format!(" in {records} records") } else { String::new() };
            let bias = match bias {
                Bias::Assumed if report.pairs.iter().all(|p| p.two_sensors) => {
                    "assumed relative degree 0 (two sensors of one signal)".to_owned()
                }
                Bias::Assumed if report.pairs.iter().any(|p| p.two_sensors) => {
                    "assumed relative degree 1 (a strictly proper plant behind a zero-order hold), 0 of two sensors of one signal".to_owned()
                }
                Bias::Assumed => {
                    "assumed relative degree 1 (a strictly proper plant behind a zero-order hold)"
                        .to_owned()
                }
                Bias::Model(model) => {
                    format!("relative degrees of {model} behind a zero-order hold")
                }
                Bias::Given(degree) => format!("relative degree {degree} as given"),
            };
            let held =
                "; outputs were interpolated and inputs held, which makes a response look up to";
            let early = || {
                format!(
                    "{held} {} s too early: a verdict's interval ends that much later",
                    seconds(*early_s, report.sample_time_s)
                )
            };
            let caveat = if *early_s > 0.0 { early() } else { String::new() };
            format!(
                "{name}: {samples} samples{records}, one every {} s; searched 0 to {until:.4} s; {bias}{caveat}",
                number(report.sample_time_s)
            )
        }
        Searched::Events { counts, interval_s } => {
            let [a, b] = report.pairs.first().map_or(["", ""], |p| [&p.input, &p.output]);
            format!(
                "{name}: {} events of `{a}` and {} of `{b}`, typically {interval_s:.4} s apart; searched 0 to {until:.4} s",
                counts[0], counts[1]
            )
        }
        Searched::Frequencies { count, band_hz: [from, to], unambiguous_s, notes } => {
            let notes: String = notes.iter().map(|n| format!("; {n}")).collect();
            let beyond = if unambiguous_s.is_finite() && *unambiguous_s < 1e3 * until {
                format!("; delays {unambiguous_s:.4} s apart look alike")
            } else {
                String::new()
            };
            format!(
                "{name}: {count} frequencies from {from:.4} to {to:.4} Hz; searched 0 to {until:.4} s{beyond}{notes}"
            )
        }
    }
}

/// Every method with every number, as wide as it comes; [`crate::report::terminal::delay::short`] is for reading.
#[must_use]
pub fn full(report: &Report) -> String {
    let mut text = preamble(report) + "\n";
    for pair in &report.pairs {
        let arrow = if pair.output == "*" { "the states".to_owned() } else { pair.output.clone() };
        let _ = writeln!(text, "\n{} → {arrow}", pair.input);
        if !pair.findings.is_empty() {
            let shown: Vec<String> = pair
                .findings
                .iter()
                .map(|f| format!("{} ({})", f.condition.words(), f.evidence))
                .collect();
            let _ = writeln!(text, "The record shows {}.", shown.join("; "));
        }
        let shown = Shown::of(pair);
        text.push_str(&table(report, &shown).to_string());
        for estimate in &shown.rows {
            if let Some(note) = &estimate.note {
                let _ = writeln!(text, "  {}: {note}", estimate.method);
            }
        }
        if let Some(warning) = warning(pair, report.sample_time_s) {
            let _ = writeln!(text, "  {warning}");
        }
        let step = report.sample_time_s;
        let _ = match (&pair.verdict.delay_s, &pair.verdict.ci95_s) {
            (Some(delay_s), ci95_s) => {
                let (value, ends) = delay(*delay_s, *ci95_s, step);
                let ends = ends.map_or_else(String::new, |e| format!(" ({} s)", e.join(" to ")));
                writeln!(text, "Dead time {value} s{ends}: {}.", pair.verdict.why)
            }
            _ if pair.moving.is_some() => writeln!(text, "{}.", pair.verdict.why),
            _ => writeln!(text, "No trusted dead time: {}.", pair.verdict.why),
        };
        if let Some(jitter) = &pair.jitter {
            let _ = writeln!(text, "{}.", single_events(jitter, step));
        }
        if let Some(track) = &pair.track {
            text.push_str(&track_table(track, step).to_string());
        }
    }
    text
}

fn table(report: &Report, shown: &Shown<'_>) -> Table {
    let headings = [
        "method",
        "outcome",
        "dead time (s)",
        "std (s)",
        "predicted (s)",
        "95 % interval (s)",
        "raw (s)",
        "bias (samples)",
        "in the verdict",
        "run time",
    ];
    let mut table = Table::new(&headings, &[0, 1, 8]);
    let step = report.sample_time_s;
    let mut class = None;
    for e in &shown.rows {
        if shown.headed && class != Some(e.class) {
            class = Some(e.class);
            table.row(vec![format!("{}:", e.class.title())]);
        }
        let [value, interval] = delay_cells(e.delay_s, e.ci95_s, step);
        let [raw, _] = delay_cells(e.raw_delay_s, e.ci95_s, step);
        let bias =
            if e.delay_s.is_some() { e.degree_bias_samples.to_string() } else { "–".to_owned() };
        let standing = Standing::of(shown.pair, e);
        let why = reason(e).filter(|_| standing == Standing::LeftOut);
        let standing = match why {
            Some(why) => format!("{}: {why}", standing.word()),
            None => standing.word().to_owned(),
        };
        table.row(vec![
            e.method.clone(),
            e.outcome.name().replace('_', " "),
            value,
            deviation(e.std_s),
            deviation(e.predicted_std_s),
            interval,
            raw,
            bias,
            standing,
            run_time(e.time_s),
        ]);
    }
    table
}

/// Lines of a track that a person reads; the file has every sample.
const TRACK_LINES: usize = 20;

/// The delay against time, a line for each equal part of it.
fn track_table(track: &Tracked, step_s: f64) -> Table {
    let mut table = Table::new(&["record", "time (s)", "dead time (s)", "95 % band (s)"], &[]);
    let count = track.time_s.len();
    for line in 0..TRACK_LINES.min(count) {
        let i = if count <= TRACK_LINES { line } else { line * (count - 1) / (TRACK_LINES - 1) };
        let [value, band] =
            delay_cells(Some(track.delay_s[i]), Some([track.low_s[i], track.high_s[i]]), step_s);
        table.row(vec![
            (track.record[i] + 1).to_string(),
            seconds(track.time_s[i], step_s),
            value,
            band,
        ]);
    }
    table
}

/// Poor excitation and outliers, if any.
#[must_use]
pub fn warning(pair: &Pair, sample_time_s: f64) -> Option<String> {
    let poor = |std_s: f64| {
        let std = deviation(Some(std_s));
        format!(
            "poor excitation: the predicted standard deviation is {std} s, so delays one sample ({} s) apart are barely distinguishable",
            number(sample_time_s)
        )
    };
    let off = |count: usize| {
        format!(
            "{count} output samples lie far from their neighbours; if they are outliers, empty their cells, which marks them as missing"
        )
    };
    let warnings: Vec<String> =
        [pair.poor_std_s.map(poor), (pair.standing_off > 0).then(|| off(pair.standing_off))]
            .into_iter()
            .flatten()
            .collect();
    (!warnings.is_empty()).then(|| warnings.join("; "))
}

/// As many methods as a person reads at a glance.
pub(super) const A_HANDFUL: usize = 8;

/// The content of a table of a pair.
struct Shown<'a> {
    pair: &'a Pair,
    rows: Vec<&'a Estimate>,
    /// Under the headings of the classes.
    headed: bool,
}

impl<'a> Shown<'a> {
    fn of(pair: &'a Pair) -> Self {
        let headed = pair.estimates.len() > A_HANDFUL;
        let mut rows: Vec<&Estimate> = pair.estimates.iter().collect();
        if headed {
            // Stable: within a class the order of the list.
            rows.sort_by_key(|e| e.class);
        }
        Self { pair, rows, headed }
    }
}

pub(super) fn run_time(time_s: f64) -> String {
    if time_s < 1e-3 {
        format!("{:.0} µs", time_s * 1e6)
    } else if time_s < 1.0 {
        format!("{:.1} ms", time_s * 1e3)
    } else {
        format!("{time_s:.1} s")
    }
}
