//! The checks in sentences.

use std::fmt::Write as _;

use super::log::number;
use deadtime_gap::{Check, Inspection};

/// The output of `deadtime check`: the logs and their faults, then every check, failed ones first.
#[must_use]
pub fn text(found: &Inspection) -> String {
    let mut text = String::new();
    for log in &found.logs {
        let every = log.sample_time_s.map_or_else(
            || "unevenly sampled".to_owned(),
            |ts| format!("one every {} s", number(ts)),
        );
        let usable = log.channels.iter().filter(|c| c.ok).count();
        let _ = writeln!(
            text,
            "{}: {} samples, {every}, {:.3} s in all; {usable} of {} channels of {} can be used",
            log.log,
            log.samples,
            log.duration_s,
            log.channels.len(),
            found.model
        );
        for finding in log.time.iter().chain(log.channels.iter().filter_map(|c| c.finding.as_ref()))
        {
            let _ = writeln!(text, "  {finding}");
        }
        for c in log.channels.iter().filter(|c| c.ok && c.missing > 0) {
            let percent = 100.0 * c.missing as f64 / log.samples.max(1) as f64;
            let _ =
                writeln!(text, "  `{}` misses {} samples ({percent:.1} %)", c.channel, c.missing);
        }
    }
    for clocks in &found.clocks {
        for topic in &clocks.topics {
            let name = if topic.topic.is_empty() {
                clocks.log.clone()
            } else {
                format!("{}, {}", clocks.log, topic.topic)
            };
            if let (Some([low, middle, high]), Some(longest)) = (topic.steps_s, topic.longest_s)
                && (!topic.topic.is_empty() || low < 0.95 * middle || longest > 1.05 * middle)
            {
                let _ = writeln!(
                    text,
                    "{name}: {} stamps, {} s apart; 90 % of the steps {} s to {} s, the longest {} s",
                    topic.samples,
                    number(middle),
                    number(low),
                    number(high),
                    number(longest)
                );
            }
        }
        for offset in &clocks.offsets {
            let _ =
                writeln!(text, "  `{}` and `{}`: {}", offset.first, offset.second, offset.finding);
        }
    }
    if let Some(why) = &found.not_run {
        let _ = writeln!(text, "The checks were not run: {why}.");
    }
    text + &lines(&found.checks)
}

/// One line per check: failed, undecided, passed.
#[must_use]
pub fn lines(checks: &[Check]) -> String {
    let mut text = String::new();
    for (ok, word) in [(Some(false), "LOOK"), (None, "  ? "), (Some(true), "  ok")] {
        // Checks that are undecided for one reason share a line.
        let mut said: Vec<(Vec<&str>, &str)> = Vec::new();
        for check in checks.iter().filter(|c| c.ok == ok) {
            let name = check.check.name();
            match said.iter_mut().find(|(_, finding)| ok.is_none() && *finding == &*check.finding) {
                Some((names, _)) => names.push(name),
                None => said.push((vec![name], &check.finding)),
            }
        }
        for (names, finding) in said {
            let _ = writeln!(text, "  {word}  {:<16}  {finding}", names.join(", "));
        }
    }
    text
}
