//! The progress of long work: the work reports it, and the caller reads it.

use std::fmt::Display;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, PoisonError};

/// The finished part of the work, 0 to 1, and its current step.
type Report = (f64, String);

/// Where reports go.
#[derive(Debug, Default)]
struct Reader {
    last: Mutex<Option<Report>>,
    each: Option<Sender<Report>>,
}

/// The progress of work; copies share one state. Without a reader, as by default, a report costs nothing.
#[derive(Debug, Clone, Default)]
pub struct HowFar(Option<Stretch>);

/// A stretch of the whole.
#[derive(Debug, Clone)]
struct Stretch {
    reader: Arc<Reader>,
    from: f64,
    to: f64,
}

impl HowFar {
    /// For work whose reader asks for the last report.
    #[must_use]
    pub fn watched() -> Self {
        Self::read_by(Reader::default())
    }

    /// For work whose reader receives each report in order.
    #[must_use]
    pub fn sent(each: Sender<(f64, String)>) -> Self {
        Self::read_by(Reader { each: Some(each), ..Reader::default() })
    }

    fn read_by(reader: Reader) -> Self {
        Self(Some(Stretch { reader: Arc::new(reader), from: 0.0, to: 1.0 }))
    }

    /// The same for one part of the work, which lasts from `from` to `to` of the whole, 0 to 1.
    #[must_use]
    pub fn part(&self, from: f64, to: f64) -> Self {
        let within = |part: &Stretch, share: f64| part.from + (part.to - part.from) * share;
        Self(self.0.as_ref().map(|part| Stretch {
            reader: Arc::clone(&part.reader),
            from: within(part, from),
            to: within(part, to),
        }))
    }

    /// Reports the finished part, 0 to 1, and the current step.
    pub fn at(&self, share: f64, what: &dyn Display) {
        if let Some(part) = &self.0 {
            let share = part.from + (part.to - part.from) * share.clamp(0.0, 1.0);
            let report = (share, what.to_string());
            let mut last = part.reader.last.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(each) = &part.reader.each {
                // A reader who left misses nothing that it wants.
                let _ = each.send(report.clone());
            }
            *last = Some(report);
        }
    }

    /// The last report: the finished part, 0 to 1, and the current step.
    #[must_use]
    pub fn told(&self) -> Option<(f64, String)> {
        self.0.as_ref().and_then(|part| {
            part.reader.last.lock().unwrap_or_else(PoisonError::into_inner).clone()
        })
    }

    /// Work of `all` equal steps, in any order and on any thread.
    #[must_use]
    pub fn steps<'a>(&'a self, all: usize, what: &'a str) -> Steps<'a> {
        let steps = Steps { far: self, all, done: Mutex::new(0), what };
        steps.tell(0);
        steps
    }
}

/// The progress of work that consists of equal steps.
#[derive(Debug)]
pub struct Steps<'a> {
    far: &'a HowFar,
    all: usize,
    done: Mutex<usize>,
    what: &'a str,
}

impl Steps<'_> {
    /// One more is done.
    pub fn one_more(&self) {
        let mut done = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        *done += 1;
        // Under the lock: the last report is the highest count.
        self.tell(*done);
    }

    fn tell(&self, done: usize) {
        self.far.at(
            done as f64 / self.all.max(1) as f64,
            &format_args!("{}, {done} of {}", self.what, self.all),
        );
    }
}

/// Options are equal with any reader.
impl PartialEq for HowFar {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for HowFar {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_fills_its_stretch_of_the_whole_and_nobody_has_to_look() {
        let far = HowFar::watched();
        assert_eq!(far.told(), None);
        let half = far.part(0.5, 1.0);
        half.part(0.0, 0.5).at(1.0, &"x");
        assert_eq!(far.told(), Some((0.75, "x".to_owned())));
        half.at(7.0, &"y");
        assert_eq!(far.told(), Some((1.0, "y".to_owned())));
        let nobody = HowFar::default();
        nobody.part(0.1, 0.2).at(0.5, &"z");
        assert_eq!(nobody.told(), None);
    }

    #[test]
    fn steps_count_up_to_all_of_them() {
        let far = HowFar::watched();
        let steps = far.steps(4, "fitting");
        assert_eq!(far.told(), Some((0.0, "fitting, 0 of 4".to_owned())));
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| steps.one_more());
            }
        });
        steps.one_more();
        assert_eq!(far.told(), Some((0.75, "fitting, 3 of 4".to_owned())));
    }
}
