//! Time stamps as files write them: which column they stand in, in which unit they are, and dates.

use crate::place::neighbours;
use crate::recording::TimeUnit;
use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::stats;

/// Whole numbers beyond this are counted from the first stamp, so that differences of nanoseconds since 1970 keep every digit; seconds since 1970 are, too.
const COUNTED_FROM_FIRST: i128 = 100_000_000_000;
/// Seconds since 1970 at the beginning of 2000 and of 2100: whole numbers between them are dates in seconds, and so on for thousandths.
const DATES_S: std::ops::Range<f64> = 946_684_800.0..4_102_444_800.0;
/// What a column of time may be called, lower case, its unit taken off.
const NAMES: [&str; 15] = [
    "time",
    "timestamp",
    "time_stamp",
    "stamp",
    "datetime",
    "date_time",
    "date",
    "elapsed",
    "elapsed_time",
    "header.stamp",
    "log_time",
    "rosbagtimestamp",
    "epoch",
    "unix_time",
    "utc",
];
const UNITS: [(TimeUnit, &[&str]); 4] = [
    (TimeUnit::S, &["s", "sec", "secs", "second", "seconds"]),
    (TimeUnit::Ms, &["ms", "msec", "msecs", "millis", "millisecond", "milliseconds"]),
    (TimeUnit::Us, &["us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"]),
    (TimeUnit::Ns, &["ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"]),
];

/// The unit that a header writes.
pub(super) fn unit(text: &str) -> Option<TimeUnit> {
    let text = text.trim().to_lowercase();
    UNITS.iter().find(|(_, names)| names.contains(&text.as_str())).map(|(unit, _)| *unit)
}

/// Whether a column of this name, its unit in brackets taken off, may be the time, and the unit that the name tells. `t` may be a temperature anywhere but in front.
pub(super) fn named(name: &str, first: bool) -> Option<Option<TimeUnit>> {
    let name = name.trim().to_lowercase();
    let known = |base: &str| NAMES.contains(&base) || (first && base == "t");
    if known(&name) {
        return Some(None);
    }
    if first && let Some(unit) = unit(&name) {
        return Some(Some(unit));
    }
    let open = name.strip_suffix(')').unwrap_or(&name);
    let (base, suffix) = open.rsplit_once(['_', '(', '/', ' '])?;
    known(base.trim_end_matches(['_', ' '])).then(|| unit(suffix)).flatten().map(Some)
}

/// As [`named`], of arrays, which have no order.
pub(crate) fn named_time(name: &str) -> Option<Option<TimeUnit>> {
    named(name, false)
}

/// The stamps of a table or an array.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Times {
    /// In seconds, NaN where there is none; from `origin_ns` on where there is one.
    pub(crate) time_s: Vec<f64>,
    /// Their unit.
    pub(crate) unit: TimeUnit,
    /// What they count from, nanoseconds.
    pub(crate) origin_ns: Option<i128>,
    /// How the unit was found out, where its size told it, and what the stamps count from: the end of a sentence.
    pub(crate) told: Message,
}

/// Stamps of any format, each as text would have it; they are understood as a text file's. `plain` says that whole numbers of seconds may stand there.
pub(crate) fn seconds(
    cells: impl Iterator<Item = String>,
    unit: Option<TimeUnit>,
    plain: bool,
) -> Times {
    let mut stamps = StampReader::default();
    let number = |cell: &[u8]| std::str::from_utf8(cell).ok()?.parse().ok();
    let raw: Vec<f64> =
        cells.map(|cell| stamps.read(cell.as_bytes(), unit, number).unwrap_or(f64::NAN)).collect();
    let (unit, why) = unit.map_or_else(|| stamps.guess(&raw, plain), |unit| (unit, Why::Given));
    let time_s: Vec<f64> = raw.iter().map(|stamp| stamp / unit.per_second()).collect();
    let size = if why == Why::Size { " by the size of its numbers" } else { "" };
    let again = match why {
        Why::Size => Message::from("; ").and(Remedy::TimeUnit).and(" says it otherwise"),
        Why::Rule if median_step(&time_s) >= 2.0 => {
            let every = format!(", a sample every {} s; ", shortest(median_step(&time_s)));
            Message::from(every).and(Remedy::TimeUnit).and(" says it otherwise")
        }
        _ => Message::default(),
    };
    let per_unit = (1e9 / unit.per_second()) as i128;
    let origin_ns = stamps.origin.map(|origin| origin.saturating_mul(per_unit));
    Times {
        time_s,
        unit,
        origin_ns,
        told: Message::from(format!("{size}{}", stamps.counted_from(unit))).and(again),
    }
}

/// How the unit of the time came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Why {
    /// The caller said so.
    Given,
    /// The header says so.
    Named,
    /// By the size of the stamps and of their steps.
    Size,
    /// As dates are written.
    Written,
    /// Seconds, as a column `time` is unless something else is said.
    Rule,
}

/// The stamps of one record while it is read.
#[derive(Debug, Clone, Default)]
pub(super) struct StampReader {
    origin: Option<i128>,
    dates: bool,
    started: bool,
    whole: bool,
}

impl StampReader {
    /// A stamp as a number of the file's unit (nanoseconds for dates), from the first one where the numbers are large; `None` where the cell is no stamp.
    pub(super) fn read(
        &mut self,
        cell: &[u8],
        unit: Option<TimeUnit>,
        number: impl Fn(&[u8]) -> Option<f64>,
    ) -> Option<f64> {
        let text = || std::str::from_utf8(cell).ok();
        if !self.started {
            self.dates = unit == Some(TimeUnit::Iso)
                || (unit.is_none() && number(cell).is_none() && text().and_then(date).is_some());
            self.whole = true;
            self.started = true;
            let whole = |t: &str| {
                t.parse().ok().or_else(|| number(cell).and(parts(t)).map(|(whole, _)| whole))
            };
            let first = if self.dates { text().and_then(date) } else { text().and_then(whole) };
            let large = |x: &i128| {
                x.unsigned_abs() >= COUNTED_FROM_FIRST.unsigned_abs()
                    || DATES_S.contains(&(*x as f64))
            };
            self.origin = first.filter(|x: &i128| self.dates || large(x));
        }
        let from = self.origin.unwrap_or(0);
        if self.dates {
            return date(text()?).map(|ns| ns.saturating_sub(from) as f64);
        }
        if let Some(whole) = text().and_then(|t| t.parse::<i128>().ok()) {
            return Some(whole.saturating_sub(from) as f64);
        }
        self.whole = false;
        let x = number(cell)?;
        // What stands behind the point would lose its last digits beside a large number.
        match text().filter(|_| self.origin.is_some()).and_then(parts) {
            Some((whole, behind)) => Some(whole.saturating_sub(from) as f64 + behind),
            None => Some(x - from as f64),
        }
    }

    /// Where the stamps count from, as the end of a sentence; nothing where they are as written.
    pub(super) fn counted_from(&self, unit: TimeUnit) -> String {
        match self.origin {
            Some(_) if unit == TimeUnit::Iso => ", counted from the first".to_owned(),
            Some(origin) if self.whole => format!(", counted from the first ({origin})"),
            Some(origin) => format!(", counted from {origin}"),
            None => String::new(),
        }
    }

    /// The unit of such stamps where nobody said it, and why. `plain` says that the column is called `time`, which has always meant seconds.
    pub(super) fn guess(&self, stamps: &[f64], plain: bool) -> (TimeUnit, Why) {
        if self.dates {
            return (TimeUnit::Iso, Why::Written);
        }
        let size =
            self.origin.map_or_else(|| stamps.first().copied().unwrap_or(0.0), |x| x as f64).abs();
        let dated =
            [(TimeUnit::S, 1.0), (TimeUnit::Ms, 1e3), (TimeUnit::Us, 1e6), (TimeUnit::Ns, 1e9)];
        if let Some((unit, _)) =
            dated.into_iter().find(|(_, scale)| DATES_S.contains(&(size / scale)))
        {
            return (unit, if unit == TimeUnit::S { Why::Rule } else { Why::Size });
        }
        let step = median_step(stamps);
        if !self.whole || step < 1.0 {
            return (TimeUnit::S, Why::Rule);
        }
        // Logs of buildings are taken every quarter of an hour, every hour, every day.
        let quarters = neighbours(stamps).all(|(before, after)| (after - before) % 900.0 == 0.0);
        match step {
            s if s >= 1e6 => (TimeUnit::Ns, Why::Size),
            s if s >= 1e3 && !quarters => (TimeUnit::Us, Why::Size),
            s if (2.0..1e3).contains(&s) && !plain => (TimeUnit::Ms, Why::Size),
            _ => (TimeUnit::S, Why::Rule),
        }
    }
}

/// What stands before and behind the point of a plain decimal that is not negative.
fn parts(text: &str) -> Option<(i128, f64)> {
    let (whole, behind) = text.split_once(['.', ','])?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    (digits(whole) && digits(behind))
        .then(|| Some((whole.parse().ok()?, format!("0.{behind}").parse().ok()?)))
        .flatten()
}

/// The median difference of neighbours; 0 for fewer than two stamps.
pub(crate) fn median_step(stamps: &[f64]) -> f64 {
    let steps = neighbours(stamps).map(|(before, after)| after - before).collect();
    stats::upper_median(steps).unwrap_or(0.0)
}

/// Nanoseconds since 1970 of a date by ISO 8601: `2024-03-01`, `2024-03-01T12:30:01.25Z`, `2024-03-01 12:30:01,25+01:00`. Without a zone it is taken as UTC.
pub(super) fn date(text: &str) -> Option<i128> {
    let text = text.trim();
    let (day, clock) = match text.split_once(['T', 't', ' ']) {
        Some((day, clock)) => (day, Some(clock.trim())),
        None => (text, None),
    };
    let mut parts = day.split(['-', '/']);
    let mut part = |digits: usize| {
        let text =
            parts.next().filter(|t| t.len() == digits && t.bytes().all(|b| b.is_ascii_digit()))?;
        text.parse::<i128>().ok()
    };
    let (year, month, of_month) = (part(4)?, part(2)?, part(2)?);
    if parts.next().is_some() || !(1..=12).contains(&month) || !(1..=31).contains(&of_month) {
        return None;
    }
    let seconds_ns = clock.map_or(Some(0), time_of_day)?;
    Some(days(year, month, of_month) * 86_400_000_000_000 + seconds_ns)
}

/// Days since 1970 in the Gregorian calendar: years begin in March, so that the leap day is a year's last.
fn days(year: i128, month: i128, of_month: i128) -> i128 {
    let year = if month <= 2 { year - 1 } else { year };
    let (era, of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + of_month - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

/// Nanoseconds of `HH:MM`, `HH:MM:SS`, `HH:MM:SS.fraction` with or without a zone.
fn time_of_day(text: &str) -> Option<i128> {
    let utc = text
        .strip_suffix(['Z', 'z'])
        .or_else(|| text.strip_suffix("UTC"))
        .or_else(|| text.strip_suffix("GMT"));
    let (clock, zone_min) = if let Some(clock) = utc {
        (clock.trim_end(), 0)
    } else if let Some(at) = text.rfind(['+', '-']) {
        let (clock, zone) = text.split_at_checked(at)?;
        let sign = if zone.starts_with('-') { -1 } else { 1 };
        let digits: String = zone.chars().skip(1).filter(|c| *c != ':').collect();
        let value: i128 = digits.parse().ok()?;
        (clock, sign * if digits.len() <= 2 { value * 60 } else { value / 100 * 60 + value % 100 })
    } else {
        (text, 0)
    };
    let mut parts = clock.trim_end().split(':');
    let mut whole =
        |most: i128| parts.next()?.parse::<i128>().ok().filter(|x| (0..=most).contains(x));
    let (hours, minutes) = (whole(24)?, whole(59)?);
    let seconds_ns = match parts.next() {
        None => 0,
        Some(text) => {
            let (seconds, fraction) = text.split_once(['.', ',']).unwrap_or((text, ""));
            if fraction.len() > 18 || !fraction.bytes().all(|b| b.is_ascii_digit()) {
                return None;
            }
            let nine: String = fraction.chars().chain(std::iter::repeat('0')).take(9).collect();
            // A leap second is 60.
            seconds.parse::<i128>().ok().filter(|s| (0..=60).contains(s))? * 1_000_000_000
                + nine.parse::<i128>().ok()?
        }
    };
    if parts.next().is_some() {
        return None;
    }
    Some((hours * 3600 + minutes * 60 - zone_min * 60) * 1_000_000_000 + seconds_ns)
}

/// To four digits, as short as it goes.
pub(super) fn shortest(x: f64) -> f64 {
    format!("{x:.3e}").parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_nanoseconds_since_1970() {
        // Witness: `date -u -d TEXT +%s%N` of GNU coreutils.
        for (text, ns) in [
            ("1970-01-01", 0),
            ("2024-02-29T12:30:01.25Z", 1_709_209_801_250_000_000),
            ("2000-03-01 00:00:00", 951_868_800_000_000_000),
            ("2024-03-01T13:30:01,25+01:00", 1_709_296_201_250_000_000),
            ("1969-12-31T23:59:59.999999999Z", -1),
            ("2024-03-01T07:30-0500", 1_709_296_200_000_000_000),
            ("2024-03-01 12:30:00 UTC", 1_709_296_200_000_000_000),
            ("2024-03-01 12:30 GMT", 1_709_296_200_000_000_000),
        ] {
            assert_eq!(date(text), Some(ns), "{text}");
        }
        for text in [
            "",
            "2024",
            "12:30:01",
            "2024-13-01",
            "2024-03-01T25:00",
            "2024-03-01T10:00:00.x",
            "20240301",
            "a-b-c",
            "2024-03-01T1é:00",
        ] {
            assert_eq!(date(text), None, "{text}");
        }
    }

    #[test]
    fn names_of_time_tell_their_unit() {
        for (name, unit) in [
            ("timestamp", None),
            ("time_us", Some(TimeUnit::Us)),
            ("Time (ms)", Some(TimeUnit::Ms)),
            ("stamp_ns", Some(TimeUnit::Ns)),
            ("t_s", Some(TimeUnit::S)),
            ("millis", Some(TimeUnit::Ms)),
        ] {
            assert_eq!(named(name, true), Some(unit), "{name}");
        }
        for name in ["speed", "t", "millis", "u_s", "lifetime", "temp_s", ""] {
            assert_eq!(named(name, false), None, "{name}");
        }
    }
}
