//! Dates in any order of their parts. With slashes or dashes and the year behind, the rows determine whether day or month comes first.

use super::date::{DAY_NS, century, clock_only, date, day_and_clock, days, time_of_day};
use crate::options::TimeUnit;

/// A date, or a time of day alone.
pub(super) fn written(text: &str) -> Option<i128> {
    date(text).or_else(|| Slashed::of(text)?.either()).or_else(|| clock_only(text))
}

/// Whether a cell is a date in any order of its parts.
pub(super) fn is_date(text: &str) -> bool {
    date(text).is_some() || Slashed::of(text).is_some_and(|s| s.either().is_some())
}

/// Whether a cell is a date or a time of day.
pub(super) fn is_stamp(text: &str) -> bool {
    is_date(text) || time_of_day(text.trim()).is_some()
}

/// A date with slashes or dashes and the year behind: `3/5/2024`, `03-05-2024 10:00:00`, `3/5/24`. With a time of day also one without a year,
/// `03/05 24:00:00`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Slashed {
    first: i128,
    second: i128,
    /// [`NO_YEAR`] where the date has none.
    year: i128,
    /// The year has two digits: any of the three parts may be it.
    short: bool,
    /// Since midnight.
    clock_ns: Option<i128>,
}

/// The year of dates without one, as building simulations write them: no leap year.
const NO_YEAR: i128 = 2001;

impl Slashed {
    pub(super) fn of(text: &str) -> Option<Self> {
        let (day, clock) = day_and_clock(text);
        let by = if day.contains('/') { '/' } else { '-' };
        let parts: Vec<&str> = day.split(by).collect();
        let part = |at: usize| {
            let part = *parts.get(at)?;
            let digits = part.bytes().all(|b| b.is_ascii_digit());
            (digits && (1..=4).contains(&part.len()))
                .then(|| Some((part.len(), part.parse().ok()?)))?
        };
        let ((one, first), (two, second)) = (part(0)?, part(1)?);
        let (long, year) = match parts.len() {
            2 if by == '/' && clock.is_some() => (4, NO_YEAR),
            3 => part(2)?,
            _ => return None,
        };
        let short = long == 2 && by == '/';
        let clock_ns = clock.map(time_of_day);
        if one > 2 || two > 2 || !(long == 4 || short) || clock_ns == Some(None) {
            return None;
        }
        let year = if short { century(year) } else { year };
        Some(Self { first, second, year, short, clock_ns: clock_ns.flatten() })
    }

    /// Nanoseconds since 1970, the day first or the month.
    pub(super) fn read(&self, day_first: bool) -> Option<i128> {
        let (day, month) =
            if day_first { (self.first, self.second) } else { (self.second, self.first) };
        let there = (1..=12).contains(&month) && (1..=31).contains(&day);
        let there = there && !(self.year == NO_YEAR && month == 2 && day > 28);
        there.then(|| days(self.year, month, day) * DAY_NS + self.clock_ns.unwrap_or(0))
    }

    /// By the order that is possible, the day first where both are.
    pub(super) fn either(&self) -> Option<i128> {
        self.read(true).or_else(|| self.read(false))
    }
}

/// The day part of dates with slashes, if the rows determine it. A part above 12 does, and so does a midnight that only one order makes the next one.
#[derive(Debug, Clone)]
pub(super) struct Slashes {
    day_first: Option<bool>,
    first: Slashed,
    /// The stamp before.
    last: Slashed,
    pub(super) ambiguous: bool,
}

impl Slashes {
    pub(super) fn of(text: &str, unit: Option<TimeUnit>) -> Option<Self> {
        let first = Slashed::of(text).filter(|_| date(text).is_none())?;
        let day_first = match unit {
            Some(TimeUnit::Dmy) => Some(true),
            Some(TimeUnit::Mdy) => Some(false),
            _ => None,
        };
        Some(Self { day_first, first, last: first, ambiguous: false })
    }

    /// The first stamp, ns, where the order is given.
    pub(super) fn known(&self) -> Option<i128> {
        self.first.read(self.day_first?)
    }

    /// Nanoseconds since 1970; `origin` is that of the first stamp, and moves where the order shows.
    pub(super) fn read(&mut self, text: &str, origin: &mut i128) -> Option<i128> {
        let own = Slashed::of(text)?;
        if self.day_first.is_none() {
            self.ambiguous = own.short;
            self.day_first = if own.short { None } else { self.shown(&own) }?;
            if let Some(day_first) = self.day_first {
                *origin = self.first.read(day_first)?;
            }
        }
        self.last = own;
        match self.day_first {
            Some(day_first) => own.read(day_first),
            // The day of the first stamp still.
            None => Some(*origin + own.clock_ns.unwrap_or(0) - self.first.clock_ns.unwrap_or(0)),
        }
    }

    /// The order that a stamp shows; `Some(None)` while all are of one day, `None` where both are as likely.
    pub(super) fn shown(&mut self, own: &Slashed) -> Option<Option<bool>> {
        let possible = [true, false].map(|day_first| {
            Some((self.first.read(day_first)?, self.last.read(day_first)?, own.read(day_first)?))
        });
        let same = (own.first, own.second, own.year)
            == (self.last.first, self.last.second, self.last.year);
        match possible {
            [Some(_), None] => Some(Some(true)),
            [None, Some(_)] => Some(Some(false)),
            [None, None] => None,
            [Some(_), Some(_)] if same => Some(None),
            [Some((_, day_before, day)), Some((_, month_before, month))] => {
                let next = |before: i128, at: i128| (0..DAY_NS).contains(&(at - before));
                match (next(day_before, day), next(month_before, month)) {
                    (true, false) => Some(Some(true)),
                    (false, true) => Some(Some(false)),
                    _ => {
                        self.ambiguous = true;
                        None
                    }
                }
            }
        }
    }
}
