//! Pairs whose record excites too little for any method.

use super::answers::{MethodAnswer, pair};
use super::asked::Job;
use super::chosen::Ready;
use super::words::{one_frequency_note, too_short_note};
use crate::error::Result;
use crate::estimate::{DelayEstimate, Outcome};
use crate::excitation::{SHORTEST, one_frequency};
use crate::experiment::Experiment;
use crate::report::Pair;
use crate::verdict::conclusion::{RecordFacts, Verdict};
use deadtime_identify::Record;

impl Job {
    /// The pair without estimates, and the reason: its input has one frequency, or its records too few samples. A response to one step may be short.
    pub(super) fn too_poor(
        &self,
        one: &Experiment<'_>,
        methods: &[&Ready],
        max_delay: usize,
        [i, o]: [usize; 2],
    ) -> Result<Option<Pair>> {
        let records = one.pair(0, 0)?;
        let [input, output] = [&self.inputs[i], &self.outputs[o]];
        let ts = one.sample_time();
        let samples = records.iter().map(Record::len).sum::<usize>();
        let (note, why) = if samples < SHORTEST && !records.iter().all(Record::is_one_step) {
            ("too few samples", too_short_note(samples))
        } else if let Some(line) = one_frequency(&records, max_delay) {
            ("the input has one frequency", one_frequency_note(input, output, &line, ts))
        } else {
            return Ok(None);
        };
        let answer = |ready: &&Ready| {
            let none = DelayEstimate::without(Outcome::NotRichEnough, note);
            MethodAnswer::of(ready, None, |_| Ok(none))
        };
        let answers = methods.iter().map(answer).collect::<Result<Vec<_>, _>>()?;
        let found = pair(input, output, &answers, Vec::new(), ts, &RecordFacts::default());
        Ok(Some(Pair { verdict: Verdict::none(why), ..found }))
    }
}
