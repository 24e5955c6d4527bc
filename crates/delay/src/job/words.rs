//! The sentences of a verdict that come from the record instead of the methods.

use crate::excitation::{OneFrequency, SHORTEST};
use crate::verdict::conclusion::Verdict;
use crate::verdict::refusal::EXPERIMENT;
use deadtime_signal::time::SampleTime;

/// The note on an input without any motion of its own under a controller.
pub(super) fn tied_note(input: &str, output: &str) -> String {
    format!(
        "`{input}` is a function of `{output}` alone: the controller and the plant are one equation here, and no method can separate a dead time; {EXPERIMENT}"
    )
}

/// The note on the inputs whose effects were subtracted first, each with its share of the output's power.
pub(super) fn taken_off_note(inputs: &[String], shares: &[(usize, f64)]) -> String {
    let each = shares.iter().map(|(other, share)| {
        format!("`{}` ({:.0} % of the output's power)", inputs[*other], 100.0 * share)
    });
    format!(
        "; the effects of other inputs were removed for methods that model one input: {}",
        each.collect::<Vec<_>>().join(", ")
    )
}

/// The note on a record of too few samples.
pub(super) fn too_short_note(samples: usize) -> String {
    format!("{samples} samples are too few for a dead time; at least {SHORTEST} are needed")
}

/// The note on an input of one frequency: the delays that fit its phase.
pub(super) fn one_frequency_note(
    input: &str,
    output: &str,
    line: &OneFrequency,
    ts: SampleTime,
) -> String {
    let [delay, period] =
        [line.phase_delay, line.period].map(|samples| digits(ts.to_seconds(samples), ts));
    let half = digits(ts.to_seconds(0.5 * line.period), ts);
    format!(
        "`{input}` moves at one frequency (period {period} s), which has one gain and one phase: `{output}` follows by {delay} s, of which any part may be dead time and the rest lag, or by {period} s more for each whole period ({half} s with a gain of the other sign); use steps, a multisine or a sweep"
    )
}

/// The note where methods find no dead time in a loop, and no direct path is detected.
pub(super) fn at_once_in_loop_note(verdict: &Verdict, ts: SampleTime) -> String {
    let most = verdict.ci95_s.map_or(ts.seconds(), |[_, to]| to);
    format!(
        "the record shows feedback and no direct path, and the methods find no dead time (at most {} s): the loop itself, clocks that differ or a command logged too seldom look the same; {EXPERIMENT} ({})",
        digits(most, ts),
        verdict.why
    )
}

/// The note where the interval of a dead time in a loop holds zero.
pub(super) const MAY_BE_AT_ONCE: &str =
    "the interval holds zero: the controller itself would explain the relation, too";

/// The note where the response lasts one sample: the convention of the verdict, and the dead time by the other convention.
pub(super) fn copy_note(delay_s: f64, two_sensors: bool, ts: SampleTime) -> String {
    if two_sensors {
        let held = digits((delay_s - ts.seconds()).max(0.0), ts);
        format!(
            "the response lasts one sample: the channels are taken for two sensors of one signal (relative degree 0); of a command behind a zero-order hold the dead time is {held} s"
        )
    } else {
        let copied = digits(delay_s + ts.seconds(), ts);
        format!(
            "the response lasts one sample, and relative degree 1 is assumed; between two sensors of one signal it is 0, and the dead time {copied} s"
        )
    }
}

/// The note where trusted methods find the delay at the end of the window.
pub(super) fn at_end_note(methods: &[&str], window_s: f64, ts: SampleTime) -> String {
    let verb = if methods.len() == 1 { "finds" } else { "find" };
    format!(
        "{} {verb} the longest dead time searched ({} s) or more: search longer ones, or record for longer",
        methods.join(", "),
        digits(window_s, ts)
    )
}

/// The note where the output leads the input.
pub(super) fn lead_note(input: &str, output: &str, samples: usize, ts: SampleTime) -> String {
    let by_s = digits(ts.to_seconds(samples as f64), ts);
    format!(
        "`{output}` leads `{input}` by about {by_s} s: the output leads the input; swap them; or, if a controller makes `{input}` from `{output}`, {EXPERIMENT}"
    )
}

/// The note where the output leads its command and no controller is the cause.
pub(super) fn ahead_note(input: &str, output: &str) -> String {
    format!(
        "`{output}` moves before its command `{input}`: it was smoothed both ways (filtfilt, a centred average), or its clock is ahead; the dead time is not identifiable behind that; log `{output}` unfiltered, or filtered forwards only"
    )
}

/// Seconds to a tenth of a sample.
fn digits(seconds: f64, ts: SampleTime) -> String {
    let places = (1.0 - ts.seconds().log10()).ceil().clamp(0.0, 9.0) as usize;
    format!("{seconds:.places$}")
}

/// The verdict on an input held for several samples whose later values are visible in the output. Such an input was logged less often than it was given, so the
/// delay may be longer by the hold. A delay within the hold gives a verdict without a value.
pub(super) fn held_verdict(
    verdict: Verdict,
    input: &str,
    samples: usize,
    ts: SampleTime,
) -> Verdict {
    let by_s = ts.to_seconds(samples as f64 - 1.0);
    let held = format!(
        "`{input}` changes every {samples} samples only while the output reacts sooner: it was logged more seldom than it was given, or the output drives it; what was logged too seldom makes a response look up to {} s too early",
        digits(by_s, ts)
    );
    match (verdict.delay_s, verdict.ci95_s) {
        (Some(delay_s), Some([from, to])) if delay_s < by_s => Verdict::none(format!(
            "{held}, and no more than that is seen: anything from {} to {} s fits; log `{input}` at every sample ({} s), then estimate again ({})",
            digits(from, ts),
            digits(to, ts),
            ts.seconds(),
            verdict.why
        )),
        (Some(_), _) => Verdict {
            why: format!("{}; {held}, and the interval ends that much later", verdict.why),
            ..verdict
        },
        (None, _) => Verdict { why: format!("{}; {held}", verdict.why), ..verdict },
    }
}
