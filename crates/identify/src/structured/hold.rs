//! Delayed inputs: the instants within a sample at which held inputs switch, and their values between these.

use super::record::LogRecord;

/// Within this share of a sample of a whole number, a dead time counts as whole: time stamps are no more accurate.
const WHOLE: f64 = 1e-6;

/// A dead time in samples.
#[derive(Debug, Clone, Copy)]
struct Late {
    whole: usize,
    /// The remainder, 0 to 1: the instant within a sample at which the input switches.
    part: f64,
}

/// A stretch of a sample with constant inputs, as shares of the sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    pub(super) from: f64,
    pub(super) length: f64,
}

/// Zero-order holds behind dead times.
#[derive(Debug)]
pub(super) struct Hold {
    late: Vec<Late>,
    segments: Vec<Segment>,
}

impl Hold {
    pub(super) fn new(delays_s: &[f64], step_s: f64) -> Self {
        let late = |&delay_s: &f64| {
            let samples = delay_s / step_s;
            let nearest = samples.round();
            if (samples - nearest).abs() <= WHOLE {
                Late { whole: nearest as usize, part: 0.0 }
            } else {
                Late { whole: samples.floor() as usize, part: samples - samples.floor() }
            }
        };
        let late: Vec<Late> = delays_s.iter().map(late).collect();
        let mut edges: Vec<f64> = late.iter().map(|l| l.part).chain([0.0, 1.0]).collect();
        edges.sort_by(f64::total_cmp);
        edges.dedup();
        let segments =
            edges.windows(2).map(|e| Segment { from: e[0], length: e[1] - e[0] }).collect();
        Self { late, segments }
    }

    /// The stretches of a sample, in order; only one if every dead time is a whole number of samples.
    pub(super) fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// The inputs from `from` on in the sample that starts at row `row`. Before a record's first row they equal that row's.
    pub(super) fn inputs(&self, record: &LogRecord, row: usize, from: f64, u: &mut [f64]) {
        for (i, (to, late)) in u.iter_mut().zip(&self.late).enumerate() {
            let back = late.whole.saturating_add(usize::from(late.part > from));
            *to = record.u[row.saturating_sub(back) * self.late.len() + i];
        }
    }

    /// The value of input `i` until `from`, if it switches then.
    pub(super) fn before(
        &self,
        record: &LogRecord,
        row: usize,
        from: f64,
        i: usize,
    ) -> Option<f64> {
        let late = self.late[i];
        let back = late.whole.saturating_add(1);
        (late.part == from).then(|| record.u[row.saturating_sub(back) * self.late.len() + i])
    }
}
