//! The first part of long logs. A diagnosis simulates its logs some thousand times, and far fewer rows identify a cause than a long log has.
//!
//! The part is the first one, in one piece: its initial state is that of the model, and clocks and queues accumulate from there. No rows are skipped: a log of
//! every tenth row would have other commands and other delays than the machine.
//!
//! How it can be wrong: an event in later rows is not found. The resulting model therefore runs over the whole log once. Its error in the unused rows is
//! reported with the error in the used rows. A window of the log makes the later rows the used ones.

use std::borrow::Cow;

use super::record::SHORTEST;
use crate::error::Result;
use crate::format::caveat::Caveat;
use deadtime_log::Log;

/// The used parts of training and held-out logs, and the caveat.
pub(crate) struct Parts<'a> {
    pub(crate) logs: Cow<'a, [Log]>,
    pub(crate) holdout: Cow<'a, [Log]>,
    pub(crate) caveats: Vec<Caveat>,
    /// The logs that were cut, and the used rows of each.
    pub(crate) cut: Vec<(&'a Log, usize)>,
}

impl<'a> Parts<'a> {
    /// This number of rows of all logs together, a share of each; all rows where there are no more.
    ///
    /// # Errors
    /// Those of [`Log::window`].
    pub(crate) fn of(logs: &'a [Log], holdout: &'a [Log], rows: usize) -> Result<Self> {
        let total: usize = logs.iter().chain(holdout).map(Log::len).sum();
        if total <= rows {
            return Ok(Self {
                logs: logs.into(),
                holdout: holdout.into(),
                caveats: Vec::new(),
                cut: Vec::new(),
            });
        }
        let (mut caveats, mut cuts) = (Vec::new(), Vec::new());
        let mut part = |log: &'a Log| -> Result<Log> {
            let used =
                (((log.len() as f64) * (rows as f64) / (total as f64)) as usize).max(SHORTEST);
            let (Some(first), Some(last)) =
                (log.time_s().first(), log.time_s().get(used.saturating_sub(1)))
            else {
                return Ok(log.clone());
            };
            if used >= log.len() {
                return Ok(log.clone());
            }
            let cut = log.window(None, Some(last - first))?;
            let until_s = format!("{:.1}", last - first);
            caveats.push(Caveat::FirstPart {
                log: log.source().to_owned(),
                rows: log.len(),
                used: cut.len(),
                until_s,
            });
            cuts.push((log, cut.len()));
            Ok(cut)
        };
        let logs = logs.iter().map(&mut part).collect::<Result<Vec<_>>>()?;
        let holdout = holdout.iter().map(&mut part).collect::<Result<Vec<_>>>()?;
        Ok(Self { logs: logs.into(), holdout: holdout.into(), caveats, cut: cuts })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_log::Channel;

    fn log(name: &str, rows: u32) -> Log {
        let time_s: Vec<f64> = (0..rows).map(|k| 5.0 + 0.1 * f64::from(k)).collect();
        Log::new(name, time_s.clone(), vec![Channel::new("u", None, time_s)]).unwrap()
    }

    #[test]
    fn long_logs_share_the_rows_and_say_so() {
        let (logs, holdout) = ([log("a", 600), log("b", 300)], [log("c", 100)]);
        let all = Parts::of(&logs, &holdout, 1000).unwrap();
        assert!(all.caveats.is_empty() && matches!(all.logs, Cow::Borrowed(_)));
        let part = Parts::of(&logs, &holdout, 500).unwrap();
        assert_eq!(
            part.logs.iter().chain(&*part.holdout).map(Log::len).collect::<Vec<_>>(),
            [300, 150, 50]
        );
        assert_eq!(part.logs[1].time_s(), &logs[1].time_s()[..150]);
        assert_eq!(part.caveats.len(), 3);
        assert!(
            part.caveats[0]
                .to_string()
                .starts_with("a has 600 rows, of which the first 300 were looked at, up to 29.9 s")
        );
        // No log is cut to nothing.
        assert_eq!(Parts::of(&logs, &holdout, 1).unwrap().holdout[0].len(), SHORTEST);
    }
}
