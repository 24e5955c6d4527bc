//! Time stamps in the formats of files: the column, the unit, and dates.

use crate::options::TimeUnit;
use crate::place::neighbours;
use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::stats;

/// Whole numbers beyond this are counted from the first stamp, so that differences of nanoseconds since 1970 keep every digit; seconds since 1970 are, too.
const COUNTED_FROM_FIRST: i128 = 100_000_000_000;
/// Seconds since 1970 at the beginning of 2000 and of 2100: whole numbers between them are dates in seconds, and so on for thousandths.
const DATES_S: std::ops::Range<f64> = 946_684_800.0..4_102_444_800.0;
/// The possible names of a column of time, lower case, without the unit.
const NAMES: [&str; 34] = [
    "time",
    "__time",
    "_time",
    "timestamp",
    "time_stamp",
    "stamp",
    "datetime",
    "date_time",
    "date",
    "date/time",
    "elapsed",
    "elapsed_time",
    "header.stamp",
    "log_time",
    "rosbagtimestamp",
    "epoch",
    "unix_time",
    "utc",
    "ts",
    "x_value",
    "tow",
    "gps_time",
    "zeit",
    "zeitstempel",
    "uhrzeit",
    "datum",
    "datum/zeit",
    "datum/uhrzeit",
    "datum_zeit",
    "datum_uhrzeit",
    "datum_und_zeit",
    "datum_und_uhrzeit",
    "last_changed",
    "last_updated",
];
/// Words in brackets behind a name of time that are no unit.
const ZONES: [&str; 6] = ["utc", "gmt", "local", "gps", "cet", "iso"];
const UNITS: [(TimeUnit, &[&str]); 7] = [
    (TimeUnit::S, &["s", "sec", "secs", "second", "seconds", "sek", "sekunden"]),
    (TimeUnit::Ms, &["ms", "msec", "msecs", "millis", "millisecond", "milliseconds"]),
    (TimeUnit::Us, &["us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"]),
    (TimeUnit::Ns, &["ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"]),
    (TimeUnit::Min, &["min", "mins", "minute", "minutes", "minuten"]),
    (TimeUnit::H, &["h", "hr", "hrs", "hour", "hours", "std", "stunden"]),
    (TimeUnit::D, &["d", "day", "days", "tage"]),
];

/// The unit that a header writes.
pub(super) fn unit(text: &str) -> Option<TimeUnit> {
    let text = text.trim().trim_end_matches('.').to_lowercase();
    UNITS.iter().find(|(_, names)| names.contains(&text.as_str())).map(|(unit, _)| *unit)
}

/// Whether a column of this name, without its unit in brackets, may be the time, and the unit in the name. `t` may be a temperature except in the first column.
pub(super) fn named(name: &str, first: bool) -> Option<Option<TimeUnit>> {
    let name = name.trim().to_lowercase();
    if known(&name, first) {
        return Some(None);
    }
    // As autopilots write it.
    if let Some(unit @ (TimeUnit::Ms | TimeUnit::Us | TimeUnit::Ns)) =
        name.strip_prefix("time").and_then(unit)
    {
        return Some(Some(unit));
    }
    // `h` and `d` may be a height and a distance, `min` the least.
    if first && let Some(unit) = unit(&name).filter(|unit| !long(*unit) || name.len() > 3) {
        return Some(Some(unit));
    }
    let open = name.strip_suffix(')').unwrap_or(&name);
    let (base, suffix) = open.rsplit_once(['_', '(', '/', ' '])?;
    let base = base.trim_end_matches(['_', ' ']);
    if name.ends_with(')') && known(base, first) && ZONES.contains(&suffix.trim()) {
        return Some(None);
    }
    let bare = base == "t" && !name.ends_with(')');
    known(base, first).then(|| unit(suffix)).flatten().filter(|u| !(bare && long(*u))).map(Some)
}

/// Whether a name is one of time; `t` may be a temperature anywhere but in front.
fn known(name: &str, first: bool) -> bool {
    let name = name.replace(' ', "_");
    NAMES.contains(&name.as_str()) || (first && name == "t")
}

fn long(unit: TimeUnit) -> bool {
    matches!(unit, TimeUnit::Min | TimeUnit::H | TimeUnit::D)
}

/// The text in brackets of a name of time where it is no known unit.
pub(super) fn unknown_unit(name: &str, first: bool) -> Option<String> {
    let lower = name.trim().to_lowercase();
    let (base, suffix) = lower.strip_suffix(')')?.rsplit_once('(')?;
    let strange = named(name, first).is_none() && known(base.trim_end(), first);
    strange.then(|| suffix.trim().to_owned())
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
    /// Their origin, nanoseconds.
    pub(crate) origin_ns: Option<i128>,
    /// How the unit was inferred, where the size of the stamps decided, and the epoch of the stamps: the end of a sentence.
    pub(crate) note: Message,
}

/// Stamps of any format, each as text would have it; they are understood as a text file's. `column` is the name of the time.
pub(crate) fn seconds(
    cells: impl Iterator<Item = String>,
    unit: Option<TimeUnit>,
    column: &str,
) -> Times {
    let mut stamps = StampReader::default();
    let number = |cell: &[u8]| std::str::from_utf8(cell).ok()?.parse().ok();
    let raw: Vec<f64> =
        cells.map(|cell| stamps.read(cell.as_bytes(), unit, number).unwrap_or(f64::NAN)).collect();
    let (unit, why) = unit.map_or_else(|| stamps.guess(&raw, column), |unit| (unit, Why::Given));
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
        note: Message::from(format!("{size}{}", stamps.counted_from(unit))).and(again),
    }
}

/// How the unit of the time came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Why {
    /// Given by the caller.
    Given,
    /// Given by the header.
    Named,
    /// A column of another name identifies the program that wrote the file.
    Writer,
    /// By the size of the stamps and of their steps.
    Size,
    /// As dates are written.
    Written,
    /// Seconds, the unit of a column `time` without another one.
    Rule,
}

/// The stamps of one record while it is read.
#[derive(Debug, Clone, Default)]
pub(super) struct StampReader {
    origin: Option<i128>,
    dates: bool,
    started: bool,
    whole: bool,
    /// Dates without a zone: the clocks may be changed among them.
    local: bool,
    /// Dates with slashes, of which the day or the month comes first.
    slashes: Option<Slashes>,
    /// Times of day without a date: the last one, and the midnights before it, nanoseconds.
    clock: Option<(i128, i128)>,
}

impl StampReader {
    /// A stamp as a number of the file's unit (nanoseconds for dates), from the first one where the numbers are large. `None` where the cell is no stamp.
    pub(super) fn read(
        &mut self,
        cell: &[u8],
        unit: Option<TimeUnit>,
        number: impl Fn(&[u8]) -> Option<f64>,
    ) -> Option<f64> {
        let text = || std::str::from_utf8(cell).ok();
        if !self.started {
            let date = |t: &str| number(cell).is_none() && written(t).is_some();
            self.dates = unit.is_some_and(TimeUnit::is_dates)
                || (unit.is_none() && text().is_some_and(|t| all_digits(t).is_some() || date(t)));
            self.local = self.dates && text().is_some_and(|t| is_date(t) && !zoned(t));
            self.slashes = text().filter(|_| self.dates).and_then(|t| Slashes::of(t, unit));
            self.clock =
                text().filter(|t| self.dates && !is_date(t)).and_then(written).map(|ns| (ns, 0));
            self.whole = true;
            self.started = true;
            let whole = |t: &str| {
                t.parse().ok().or_else(|| number(cell).and(parts(t)).map(|(whole, _)| whole))
            };
            let first = if self.dates { text().and_then(written) } else { text().and_then(whole) };
            let large = |x: &i128| {
                x.unsigned_abs() >= COUNTED_FROM_FIRST.unsigned_abs()
                    || DATES_S.contains(&(*x as f64))
            };
            self.origin = first.filter(|x: &i128| self.dates || large(x));
            if let Some(known) = self.slashes.as_ref().and_then(Slashes::known) {
                self.origin = Some(known);
            }
        }
        if let (Some(slashes), Some(origin)) = (&mut self.slashes, &mut self.origin) {
            return slashes.read(text()?, origin).map(|ns| ns.saturating_sub(*origin) as f64);
        }
        let from = self.origin.unwrap_or(0);
        if self.dates {
            return self.dated(text()?).map(|ns| ns.saturating_sub(from) as f64);
        }
        if let Some(whole) = text().and_then(|t| t.parse::<i128>().ok()) {
            return Some(whole.saturating_sub(from) as f64);
        }
        self.whole = false;
        let x = number(cell)?;
        // The fraction would lose its last digits in a sum with a large whole number.
        match text().filter(|_| self.origin.is_some()).and_then(parts) {
            Some((whole, behind)) => Some(whole.saturating_sub(from) as f64 + behind),
            None => Some(x - from as f64),
        }
    }

    /// The last stamp was a date that may be read day first or month first.
    pub(super) fn is_ambiguous(&self) -> bool {
        self.slashes.as_ref().is_some_and(|slashes| slashes.ambiguous)
    }

    /// Stamps that are whole seconds so far, as this one is; `unit` where it is known.
    pub(super) fn is_coarse(&self, raw: f64, unit: Option<TimeUnit>) -> bool {
        let second = match unit {
            Some(unit) => unit.per_second(),
            None if self.dates => 1e9,
            None => 1.0,
        };
        (self.dates || self.whole) && second >= 1.0 && raw % second == 0.0
    }

    /// A date, or a time of day, which goes on behind midnight.
    fn dated(&mut self, text: &str) -> Option<i128> {
        let Some((last, midnights)) = &mut self.clock else { return date(text) };
        let ns = clock_only(text)?;
        if ns < *last - DAY_NS / 2 {
            *midnights += DAY_NS;
        }
        *last = ns;
        Some(ns + *midnights)
    }

    /// The shift of this stamp by a change of the clocks, ns. It is an hour in the night of a Sunday where the distance to the stamp before is a step plus or
    /// minus an hour. An hourly log then has one stamp twice.
    pub(super) fn clock_change(&self, before: &[f64], raw: f64) -> Option<f64> {
        const SUNDAY: i128 = 3;
        let hour = HOUR_NS as f64;
        let (last, from) = (before.last()?, self.origin.filter(|_| self.local)?);
        let still = raw == *last;
        if !still && (0.0..hour).contains(&(raw - last)) {
            return None;
        }
        let night = (from + *last as i128 + HOUR_NS / 4).rem_euclid(7 * DAY_NS) - SUNDAY * DAY_NS;
        // A step that is often enough to be known, and short enough to show an hour.
        let step = Some(median_step(before.get(before.len().saturating_sub(50)..)?))
            .filter(|step| *step > 0.0 && *step <= hour && before.len() > 3)?;
        let off = raw - last - step;
        let exact = |change: f64| (off - change).abs() <= 1e-3 * step;
        let change = [hour, -hour].into_iter().find(|change| exact(*change))?;
        (0..4 * HOUR_NS).contains(&night).then_some(change)
    }

    /// Where the stamps count from, as the end of a sentence; nothing where they are as written.
    pub(super) fn counted_from(&self, unit: TimeUnit) -> String {
        match self.origin {
            Some(_) if unit.is_dates() => ", counted from the first".to_owned(),
            Some(origin) if self.whole => format!(", counted from the first ({origin})"),
            Some(origin) => format!(", counted from {origin}"),
            None => String::new(),
        }
    }

    /// The unit of such stamps where none is given, and the reason. A column `time` has always meant seconds; one of dates counts days where its numbers are a
    /// spreadsheet's.
    pub(super) fn guess(&self, stamps: &[f64], column: &str) -> (TimeUnit, Why) {
        let plain = column == "time";
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
        let dates = ["date", "datum"].iter().any(|name| column.to_lowercase().starts_with(name));
        if (dates && SPREADSHEET_DAYS.contains(&size)) || (!self.whole && spreadsheet(size, step)) {
            return (TimeUnit::D, Why::Size);
        }
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

/// Nanoseconds of a day.
const DAY_NS: i128 = 86_400_000_000_000;
/// Days since 1900 that a spreadsheet counts from 1982 to 2064.
const SPREADSHEET_DAYS: std::ops::Range<f64> = 30_000.0..60_000.0;

/// Whether stamps are days as a spreadsheet counts them: of our days, with whole seconds between them that are no short decimals of a day.
fn spreadsheet(size: f64, step: f64) -> bool {
    let (step_s, tenthousandths) = (step * 86_400.0, step * 1e4);
    let whole = step_s.round() >= 1.0 && (step_s - step_s.round()).abs() <= 1e-3 * step_s.round();
    let decimal = (tenthousandths - tenthousandths.round()).abs() <= 1e-3;
    SPREADSHEET_DAYS.contains(&size) && step < 1.0 && whole && !decimal
}

/// Whether a date has a time zone.
fn zoned(text: &str) -> bool {
    let clock = text.trim().split_once(['T', 't', ' ']).map_or("", |(_, clock)| clock);
    let (lower, sign) = (clock.to_lowercase(), clock.contains(['+', '-']));
    sign || ["z", "utc", "gmt"].iter().any(|zone| lower.ends_with(zone))
}

/// A date, or a time of day alone.
fn written(text: &str) -> Option<i128> {
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
struct Slashed {
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
    fn of(text: &str) -> Option<Self> {
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
    fn read(&self, day_first: bool) -> Option<i128> {
        let (day, month) =
            if day_first { (self.first, self.second) } else { (self.second, self.first) };
        let there = (1..=12).contains(&month) && (1..=31).contains(&day);
        let there = there && !(self.year == NO_YEAR && month == 2 && day > 28);
        there.then(|| days(self.year, month, day) * DAY_NS + self.clock_ns.unwrap_or(0))
    }

    /// By the order that is possible, the day first where both are.
    fn either(&self) -> Option<i128> {
        self.read(true).or_else(|| self.read(false))
    }
}

/// The day part of dates with slashes, if the rows determine it. A part above 12 does, and so does a midnight that only one order makes the next one.
#[derive(Debug, Clone)]
struct Slashes {
    day_first: Option<bool>,
    first: Slashed,
    /// The stamp before.
    last: Slashed,
    ambiguous: bool,
}

impl Slashes {
    fn of(text: &str, unit: Option<TimeUnit>) -> Option<Self> {
        let first = Slashed::of(text).filter(|_| date(text).is_none())?;
        let day_first = match unit {
            Some(TimeUnit::Dmy) => Some(true),
            Some(TimeUnit::Mdy) => Some(false),
            _ => None,
        };
        Some(Self { day_first, first, last: first, ambiguous: false })
    }

    /// The first stamp, ns, where the order is given.
    fn known(&self) -> Option<i128> {
        self.first.read(self.day_first?)
    }

    /// Nanoseconds since 1970; `origin` is that of the first stamp, and moves where the order shows.
    fn read(&mut self, text: &str, origin: &mut i128) -> Option<i128> {
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
    fn shown(&mut self, own: &Slashed) -> Option<Option<bool>> {
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

/// Whether a cell is two numbers with a colon between them: hours and minutes, or minutes and seconds.
pub(super) fn is_half_a_clock(text: &str) -> bool {
    let mut parts = text.trim().split(':');
    let mut number = || parts.next().and_then(|part| part.replace(',', ".").parse::<f64>().ok());
    number().is_some() && number().is_some() && parts.next().is_none()
}

/// Nanoseconds since midnight of `HH:MM:SS`, with a fraction or AM or PM.
fn clock_only(text: &str) -> Option<i128> {
    time_of_day(text.trim()).filter(|_| text.bytes().filter(|b| *b == b':').count() == 2)
}

/// The parts before and behind the point of a plain decimal that is not negative.
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

/// The day and the time of day of a date, without what German writes around them: `01.03.2024, 12:30 Uhr`.
fn day_and_clock(text: &str) -> (&str, Option<&str>) {
    let text = text.trim();
    match text.split_once(['T', 't', ' ']) {
        Some((day, clock)) => {
            let clock = clock.trim();
            let clock = clock.strip_suffix("Uhr").map_or(clock, str::trim_end);
            (day.strip_suffix(',').unwrap_or(day), Some(clock))
        }
        None => (text, None),
    }
}

/// The year of two digits, by POSIX (`strptime`, %y): 69 to 99 are of the last century.
fn century(two: i128) -> i128 {
    if two < 69 { 2000 + two } else { 1900 + two }
}

/// Day and time of day of a date of digits alone, `20240301123001`. A count of micro- or nanoseconds has as many digits; of such counts one in 20 000 is a date.
fn all_digits(text: &str) -> Option<(&str, &str)> {
    let text = text.trim();
    let (day, clock) = text.split_at_checked(8)?;
    let there = text.len() == 14
        && text.bytes().all(|b| b.is_ascii_digit())
        && (1980..2100).contains(&day.get(..4)?.parse::<i128>().ok()?)
        && date(&format!("{day}T{clock}")).is_some();
    there.then_some((day, clock))
}

/// Months by their first three letters, English or German.
const MONTHS: [&[&str]; 12] = [
    &["jan"],
    &["feb"],
    &["mar", "mär", "mrz"],
    &["apr"],
    &["may", "mai"],
    &["jun"],
    &["jul"],
    &["aug"],
    &["sep"],
    &["oct", "okt"],
    &["nov"],
    &["dec", "dez"],
];

/// A date with the name of its month as `YYYY-MM-DD` and its time of day: `13-Feb-2026 10:00:00`, `13. Februar 2026`, `Feb 13, 2026 1:00 PM`.
fn with_name_of_month(text: &str) -> Option<String> {
    if text.bytes().filter(u8::is_ascii_alphabetic).count() < 2 {
        return None;
    }
    let ends = |c: char| matches!(c, ' ' | '-' | ',' | '/' | '.');
    let (mut rest, mut parts) = (text.trim(), Vec::with_capacity(3));
    while parts.len() < 3 {
        let at = rest.find(ends).unwrap_or(rest.len());
        let (part, behind) = rest.split_at_checked(at)?;
        parts.push(part);
        rest = behind.trim_start_matches(ends);
        if rest.is_empty() {
            break;
        }
    }
    let month = |part: &str| {
        let start: String = part.chars().take(3).flat_map(char::to_lowercase).collect();
        let letters = part.chars().all(char::is_alphabetic);
        MONTHS.iter().position(|names| letters && names.contains(&start.as_str())).map(|at| at + 1)
    };
    let (day, month, year) = match parts.as_slice() {
        [day, name, year] if month(name).is_some() => (day, month(name)?, year),
        [name, day, year] => (day, month(name)?, year),
        _ => return None,
    };
    let digits = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
    let there = digits(day) && (1..=2).contains(&day.len()) && digits(year) && year.len() == 4;
    there.then(|| format!("{year}-{month:02}-{day:0>2} {rest}").trim_end().to_owned())
}

/// Nanoseconds since 1970 of a date by ISO 8601: `2024-03-01`, `2024-03-01T12:30:01.25Z`, `2024-03-01 12:30:01,25+01:00`, `20240301T123001Z`; also `01.03.2024 12:30`, `1.3.24`,
/// `1-Mar-2024`, `20240301123001` and `12:30:01 PM`.
/// Without a zone it is taken as UTC.
pub(super) fn date(text: &str) -> Option<i128> {
    if let Some((day, clock)) = all_digits(text) {
        return date(&format!("{day}T{clock}"));
    }
    if let Some(text) = with_name_of_month(text) {
        return date(&text);
    }
    let (day, clock) = day_and_clock(text);
    let digits = |text: &str| text.bytes().all(|b| b.is_ascii_digit());
    let compact = day.len() == 8 && digits(day) && clock.is_some();
    let (year, month, of_month) = if compact {
        (day.get(..4)?, day.get(4..6)?, day.get(6..)?)
    } else {
        let mut parts = day.split(['-', '/', '.']);
        let three = (parts.next()?, parts.next()?, parts.next()?);
        if parts.next().is_some() {
            return None;
        }
        // Points separate day, month and year, in this order.
        if day.contains('.') { (three.2, three.1, three.0) } else { three }
    };
    let part = |text: &str, least: usize, most: usize| {
        (digits(text) && (least..=most).contains(&text.len())).then(|| text.parse().ok())?
    };
    let points = day.contains('.');
    let least = if points { 1 } else { 2 };
    let short = points && year.len() == 2;
    let (year, month, of_month): (i128, i128, i128) = (
        part(year, if short { 2 } else { 4 }, 4)?,
        part(month, least, 2)?,
        part(of_month, least, 2)?,
    );
    let year = if short { century(year) } else { year };
    if !(1..=12).contains(&month) || !(1..=31).contains(&of_month) {
        return None;
    }
    let seconds_ns = match clock {
        None => 0,
        Some(clock) if compact => time_of_day(&spread(clock)?)?,
        Some(clock) => time_of_day(clock)?,
    };
    Some(days(year, month, of_month) * DAY_NS + seconds_ns)
}

/// `123001.5Z` as `12:30:01.5Z`.
fn spread(clock: &str) -> Option<String> {
    if clock.contains(':') {
        return Some(clock.to_owned());
    }
    let (hours, rest) = clock.split_at_checked(2)?;
    let (minutes, rest) = rest.split_at_checked(2)?;
    let seconds = rest.starts_with(|c: char| c.is_ascii_digit());
    Some(format!("{hours}:{minutes}{}{rest}", if seconds { ":" } else { "" }))
}

/// Days since 1970 in the Gregorian calendar: years begin in March, so that the leap day is a year's last.
fn days(year: i128, month: i128, of_month: i128) -> i128 {
    let year = if month <= 2 { year - 1 } else { year };
    let (era, of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + of_month - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

/// Nanoseconds of an hour.
const HOUR_NS: i128 = 3_600_000_000_000;

/// Nanoseconds of `HH:MM`, `HH:MM:SS`, `HH:MM:SS.fraction` with or without a zone.
pub(super) fn time_of_day(text: &str) -> Option<i128> {
    let half = |end: &[&str]| end.iter().find_map(|end| text.strip_suffix(end));
    let halves = [half(&["AM", "am", "a.m."]), half(&["PM", "pm", "p.m."])];
    for (at, clock) in halves.into_iter().enumerate() {
        let Some(clock) = clock.map(str::trim_end) else { continue };
        // Twelve comes before one.
        let ns = time_of_day(clock).filter(|ns| (HOUR_NS..13 * HOUR_NS).contains(ns))?;
        return Some(ns % (12 * HOUR_NS) + at as i128 * 12 * HOUR_NS);
    }
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
            ("20240301T123000Z", 1_709_296_200_000_000_000),
            ("20240301T1330+0100", 1_709_296_200_000_000_000),
            ("01.03.2024 12:30", 1_709_296_200_000_000_000),
            ("1.3.2024 12:30:00 PM", 1_709_296_200_000_000_000),
            ("2024-03-01 12:30 AM", 1_709_253_000_000_000_000),
            ("2024-02-29 24:00:00", 1_709_251_200_000_000_000),
            ("01.03.24 12:30:00", 1_709_296_200_000_000_000),
            ("1.3.24, 12:30:00,0 Uhr", 1_709_296_200_000_000_000),
            ("01.03.2024 12:30 Uhr", 1_709_296_200_000_000_000),
            ("20240301123000", 1_709_296_200_000_000_000),
            ("01-Mar-2024 12:30:00", 1_709_296_200_000_000_000),
            ("1. März 2024 12:30", 1_709_296_200_000_000_000),
            ("March 1, 2024 12:30 PM", 1_709_296_200_000_000_000),
            ("1 Mar 2024", 1_709_251_200_000_000_000),
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
            "20241301123000",
            "30240301123000",
            "01-Foo-2024 12:30:00",
            "Mar 2024",
            "Mar é 2024",
            "1.3.4",
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
            ("Time (min)", Some(TimeUnit::Min)),
            ("tow(msec)", Some(TimeUnit::Ms)),
            ("elapsed time (h)", Some(TimeUnit::H)),
            ("days", Some(TimeUnit::D)),
            ("Zeit", None),
            ("Datum (UTC)", None),
            ("ts", None),
            ("Datum/Zeit", None),
            ("Datum Uhrzeit", None),
            ("Zeit (Std.)", Some(TimeUnit::H)),
            ("Zeit (Minuten)", Some(TimeUnit::Min)),
            ("_time", None),
        ] {
            assert_eq!(named(name, true), Some(unit), "{name}");
        }
        for name in ["speed", "t", "millis", "u_s", "lifetime", "temp_s", ""] {
            assert_eq!(named(name, false), None, "{name}");
        }
        for name in ["h", "d", "min", "t_min", "Time (fortnights)"] {
            assert_eq!(named(name, true), None, "{name}");
        }
        assert_eq!(unknown_unit("Time (Fortnights)", false).as_deref(), Some("fortnights"));
        for name in ["Time (min)", "time", "height (ft)", "t_min"] {
            assert_eq!(unknown_unit(name, true), None, "{name}");
        }
    }

    /// The same stamps in every way of writing them: hours, minutes and seconds from a drawn start.
    #[test]
    fn stamps_are_understood_however_they_are_written() {
        use crate::csv::table::read_from;
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(9);
        for _ in 0..40 {
            let (step, rows) = ([5, 60, 300, 900][rng.random_range(0..4)], 60);
            // Late enough that some of them pass midnight, where the day may turn.
            let start = rng.random_range(0..86_400 / 5) * 5;
            let at = |k: i64| start + k * step;
            let clock = |k: i64| {
                let s = at(k) % 86_400;
                (s / 3600, s / 60 % 60, s % 60, 5 + at(k) / 86_400)
            };
            let twelve =
                |h: i64| (if h % 12 == 0 { 12 } else { h % 12 }, if h < 12 { "AM" } else { "PM" });
            let forms: [(&str, &dyn Fn(i64) -> String); 15] = [
                ("Time (min)", &|k| format!("{:.6}", at(k) as f64 / 60.0)),
                ("time [h]", &|k| format!("{:.9}", at(k) as f64 / 3600.0)),
                ("t (days)", &|k| format!("{:.10}", at(k) as f64 / 86_400.0)),
                ("timestamp", &|k| format!("{:.10}", 45_356.0 + at(k) as f64 / 86_400.0)),
                ("time", &|k| {
                    let (h, m, s, _) = clock(k);
                    format!("{h:02}:{m:02}:{s:02}")
                }),
                ("Uhrzeit", &|k| {
                    let (h, m, s, _) = clock(k);
                    let (h, half) = twelve(h);
                    format!("{h}:{m:02}:{s:02} {half}")
                }),
                ("Datum", &|k| {
                    let (h, m, s, d) = clock(k);
                    format!("{d:02}.03.2024 {h:02}:{m:02}:{s:02}")
                }),
                ("ts", &|k| {
                    let (h, m, s, d) = clock(k);
                    format!("202403{d:02}T{h:02}{m:02}{s:02}Z")
                }),
                ("Datum/Zeit", &|k| {
                    let (h, m, s, d) = clock(k);
                    format!("{d:02}.03.24 {h:02}:{m:02}:{s:02}")
                }),
                ("Datum und Uhrzeit", &|k| {
                    let (h, m, s, d) = clock(k);
                    format!("\"{d}.3.2024, {h:02}:{m:02}:{s:02} Uhr\"")
                }),
                ("ts", &|k| {
                    let (h, m, s, d) = clock(k);
                    format!("202403{d:02}{h:02}{m:02}{s:02}")
                }),
                ("Date", &|k| {
                    let (h, m, s, d) = clock(k);
                    format!("{d:02}-Mar-2024 {h:02}:{m:02}:{s:02}")
                }),
                ("Date/Time", &|k| {
                    let (h, m, s, d) = clock(k);
                    // Days that no month has.
                    let d = d + 8;
                    if h == 0 {
                        format!(" 03/{:02}  24:{m:02}:{s:02}", d - 1)
                    } else {
                        format!(" 03/{d:02}  {h:02}:{m:02}:{s:02}")
                    }
                }),
                ("Datum", &|k| {
                    let (h, m, s, d) = clock(k);
                    format!("{}-03-2024 {h:02}:{m:02}:{s:02}", d + 8)
                }),
                ("Zeit", &|k| {
                    let (h, m, s, d) = clock(k);
                    if h == 0 {
                        format!("2024-03-{:02} 24:{m:02}:{s:02}", d - 1)
                    } else {
                        format!("2024-03-{d:02} {h:02}:{m:02}:{s:02}")
                    }
                }),
            ];
            for (name, write) in forms {
                let mut text = format!("{name},u\n");
                (0..rows).for_each(|k| text += &format!("{},{k}\n", write(k)));
                let log = read_from("a.csv", text.as_bytes())
                    .unwrap_or_else(|e| panic!("{name}: {e}\n{text}"));
                let first = log.time_s()[0];
                for (k, time_s) in log.time_s().iter().enumerate() {
                    let off = time_s - first - (k as i64 * step) as f64;
                    assert!(off.abs() < 1e-4, "{name}, row {k}: {time_s} {first} {step}");
                }
            }
        }
        for unit in ["fortnights", "ticks", "count"] {
            for name in [format!("Time ({unit})"), format!("time [{unit}]")] {
                let text = format!("{name},u\n0,1\n1,2\n");
                let said = read_from("a.csv", text.as_bytes()).unwrap_err().to_string();
                assert!(said.contains(unit) && said.contains("`time_unit`"), "{said}");
            }
        }
        // Two numbers with a colon are hours and minutes, or minutes and seconds.
        for (cell, half) in [("03:00", true), ("00:00.5", true), ("noon", false)] {
            let text = format!("time,u\n{cell},1\n{cell},2\n");
            let said = read_from("a.csv", text.as_bytes()).unwrap_err().to_string();
            let parts = ["row 2", cell, "is not understood", "2026-02-01 13:00:00.5"];
            assert!(parts.iter().all(|part| said.contains(part)), "{said}");
            assert_eq!(said.contains("minutes and seconds"), half, "{said}");
        }
        // A column of dates counts days where a spreadsheet would, at any step.
        for (name, step) in [("date", 1.0), ("Datum", 0.25), ("Date", 7.0), ("date", 0.01)] {
            let rows: String =
                (0..50).map(|k| format!("{},{k}\n", 45_356.0 + f64::from(k) * step)).collect();
            let log = read_from("a.csv", format!("{name},u\n{rows}").as_bytes()).unwrap();
            let first = log.time_s()[1] - log.time_s()[0];
            assert!((first - step * 86_400.0).abs() < 1e-3, "{name} {step}: {first}");
        }
        // Stamps that only look like days of a spreadsheet.
        for step in [0.01, 0.02, 0.001, 0.1, 0.0005] {
            let rows: String =
                (0..50).map(|k| format!("{:.4},{k}\n", 45_356.0 + f64::from(k) * step)).collect();
            let log = read_from("a.csv", format!("timestamp,u\n{rows}").as_bytes()).unwrap();
            assert!((log.time_s()[10] - log.time_s()[0] - 10.0 * step).abs() < 1e-6, "{step}");
        }
    }

    #[test]
    fn a_change_of_the_clocks_moves_local_stamps_and_no_others() {
        use crate::csv::table::recording_from;
        use crate::options::ReadOptions;
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(10);
        let day = |d: i128| d * 86_400;
        // The last Sundays of March and October 2023, at which hour local time changes, and by how much.
        for (of, change) in [(days(2023, 3, 26), 3600), (days(2023, 10, 29), -3600)] {
            for round in 0..30 {
                let step = [60, 300, 600, 900, 3600][rng.random_range(0..5)];
                let at = day(of) + 3600 * if change > 0 { 2 } else { 3 };
                let start = at - step * rng.random_range(5..20);
                let zone = ["", "Z", "+02:00"][round % 3];
                let mut text = "time,u\n".to_owned();
                for k in 0..60 {
                    let s = start + k * step;
                    let local = if s >= at { s + change } else { s };
                    let (d, s) = (local.div_euclid(86_400), local.rem_euclid(86_400));
                    let month = if change > 0 { 3 } else { 10 };
                    let of_month = d - days(2023, month, 1) + 1;
                    text += &format!(
                        "2023-{month:02}-{of_month:02}T{:02}:{:02}:{:02}{zone},{k}\n",
                        s / 3600,
                        s / 60 % 60,
                        s % 60
                    );
                }
                let read = recording_from("a.csv", text.as_bytes(), &ReadOptions::default());
                if !zone.is_empty() {
                    // With a zone nothing is moved: back is an error, forward a gap.
                    assert_eq!(read.is_err(), change < 0, "{zone}");
                    continue;
                }
                let read = read.unwrap();
                assert!(read.notes.join("|").contains("by an hour"), "{:?}", read.notes);
                let log = read.into_log().unwrap();
                for (k, time_s) in log.time_s().iter().enumerate() {
                    assert_eq!(*time_s, (k as i128 * step) as f64);
                }
            }
        }
    }

    #[test]
    fn date_and_time_of_day_are_read_together_and_rows_written_twice_once() {
        use crate::csv::table::recording_from;
        use crate::options::ReadOptions;
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(12);
        for names in ["Date,Time", "date,time", "Datum,Uhrzeit", "Time,Date"] {
            let first = names.starts_with('D') || names.starts_with('d');
            let (mut text, mut twice) = (format!("{names},pump,y\n"), 0);
            let start = rng.random_range(80_000..86_000);
            for k in 0..80 {
                let s = start + k * 300;
                let (date, clock) = (
                    format!("2024-03-{:02}", 5 + s / 86_400),
                    format!("{:02}:{:02}:{:02}", s / 3600 % 24, s / 60 % 60, s % 60),
                );
                let (a, b) = if first { (date, clock) } else { (clock, date) };
                let row = format!("{a},{b},{},{}\n", if k % 2 == 0 { "ON" } else { "off" }, k);
                text += &row;
                if rng.random_bool(0.1) {
                    text += &row;
                    twice += 1;
                }
            }
            let read = recording_from("a.csv", text.as_bytes(), &ReadOptions::default()).unwrap();
            let notes = read.notes.join("|");
            assert!(notes.contains("the date stands in the column"), "{notes}");
            assert_eq!(notes.contains(&format!("{twice} rows are the same")), twice > 0, "{notes}");
            let log = read.into_log().unwrap();
            assert_eq!(log.names().collect::<Vec<_>>(), ["pump", "y"]);
            assert_eq!(log.input("pump").unwrap()[..3], [1.0, 0.0, 1.0]);
            for (k, time_s) in log.time_s().iter().enumerate() {
                assert_eq!(*time_s, 300.0 * k as f64, "{names}");
            }
        }
        // The same time with other numbers is no row written twice.
        let text = "time,u\n0,1\n1,2\n1,3\n2,4\n";
        assert!(recording_from("a.csv", text.as_bytes(), &ReadOptions::default()).is_err());
    }

    #[test]
    fn rows_above_a_table_are_left_out_and_said() {
        use crate::csv::table::recording_from;
        use crate::options::ReadOptions;
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(14);
        let above =
            ["Model", "Firmware", "Time", "Date", "Product", "Scale", "Sample Interval", "Units"];
        let values =
            ["TBS1000", "v4.06", "10:00:00", "2024-03-05", "Blackbox", "0.001", "4e-06", "S"];
        for _ in 0..100 {
            let by = [",", ";", "\t"][rng.random_range(0..3)];
            let mut text = String::new();
            // The first row belongs to no table, for any following row.
            text += &format!("Product{by}scope 7\n");
            let rows = rng.random_range(0..30);
            for _ in 0..rows {
                let which = rng.random_range(0..above.len());
                let end = by.repeat(rng.random_range(0..3));
                text += &format!("{}{by}{}{end}\n", above[which], values[which]);
            }
            if rng.random() {
                text += &format!("{by}{by}\n");
            }
            let name = ["TIME", "time", "X_Value", "Zeit", "timestamp"][rng.random_range(0..5)];
            text += &format!("{name}{by}CH1{by}CH2\n");
            (0..40).for_each(|k| {
                text += &format!("{:.3}{by}{k}{by}{}\n", -0.02 + 0.001 * f64::from(k), k % 3)
            });
            let read = recording_from("a.csv", text.as_bytes(), &ReadOptions::default())
                .unwrap_or_else(|e| panic!("{e}\n{text}"));
            assert!(read.notes.join("|").contains("stand above the table"), "{:?}", read.notes);
            let log = read.into_log().unwrap();
            assert_eq!((log.len(), log.input("CH1").unwrap()[39]), (40, 39.0), "{text}");
        }
        // Units below the names, without one of time; rows of words that end in numbers; a blackbox.
        for above in [
            "",
            "Model,7\nScale,0.001\n",
            "Scale,0.001\nSerial Number,SDS1\nChannels,2\nX_Dimension,Time,Time\nX0,0.0,0.0\nDelta_X,0.001,0.001\n",
        ] {
            for (header, scale) in [
                ("X,CH1,CH2\nSecond,Volt,Volt\n", 1.0),
                ("x-axis,CH1,CH2\n(ms),(V),(V)\n", 1e-3),
                ("Second,CH1,CH2\n", 1.0),
                ("Time,CH1,CH2\ns,V,V\n", 1.0),
                ("Time,CH1,CH2\n", 1.0),
            ] {
                let mut text = format!("{above}{header}");
                (0..40).for_each(|k| text += &format!("{:.3},{k},{}\n", 0.5 * f64::from(k), k % 3));
                let log = recording_from("a.csv", text.as_bytes(), &ReadOptions::default())
                    .unwrap_or_else(|e| panic!("{e}\n{text}"))
                    .into_log()
                    .unwrap();
                assert_eq!(log.input("CH1").unwrap()[39], 39.0, "{text}");
                let step = log.time_s()[1] - log.time_s()[0];
                assert!((step - 0.5 * scale).abs() < 1e-12, "{step} {text}");
            }
        }
        let rows: String = (0..40).map(|k| format!("{k},{},{k}\n", 11_000_000 + 500 * k)).collect();
        let text = format!("Product,Blackbox\nloopIteration,time,gyro\n{rows}");
        let read = recording_from("a.csv", text.as_bytes(), &ReadOptions::default()).unwrap();
        assert!(read.notes.join("|").contains("in microseconds"), "{:?}", read.notes);
        let log = read.into_log().unwrap();
        assert!((log.time_s()[1] - log.time_s()[0] - 5e-4).abs() < 1e-9);
        // Dates in the first row are no names.
        let rows: String = (0..20).map(|k| format!("2024-03-05T10:00:{k:02},{k},1\n")).collect();
        let said = recording_from("a.csv", rows.as_bytes(), &ReadOptions::default()).unwrap_err();
        assert!(said.to_string().contains("`columns`"), "{said}");
        // Without a table the first row is named, as ever.
        let text = "Product,scope 7\nModel,3\nTime,10:00:00\n";
        let said = recording_from("a.csv", text.as_bytes(), &ReadOptions::default()).unwrap_err();
        assert!(
            said.to_string().contains("row 1") && said.to_string().contains("`Product`"),
            "{said}"
        );
    }

    #[test]
    fn dates_with_slashes_are_read_by_the_order_that_they_show_or_refused() {
        use crate::csv::table::recording_from;
        use crate::options::ReadOptions;
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(51);
        for _ in 0..300 {
            let (day, month) = (rng.random_range(1..28_i64), rng.random_range(1..13_i64));
            let day_first = rng.random_bool(0.5);
            let (step, start) =
                ([10, 60, 600][rng.random_range(0..3)], rng.random_range(0..86_400));
            let rows = 120;
            let padded = rng.random_bool(0.5);
            let mut text = "time,u\n".to_owned();
            for k in 0..rows {
                let s = start + k * step;
                let (d, s) = (day + s / 86_400, s % 86_400);
                let (a, b) = if day_first { (d, month) } else { (month, d) };
                let date =
                    if padded { format!("{a:02}/{b:02}/2024") } else { format!("{a}/{b}/2024") };
                text += &format!("{date} {:02}:{:02}:{:02},{k}\n", s / 3600, s / 60 % 60, s % 60);
            }
            let units = [None, Some(if day_first { TimeUnit::Dmy } else { TimeUnit::Mdy })];
            for time_unit in units {
                let options = ReadOptions { time_unit, ..ReadOptions::default() };
                let log = recording_from("a.csv", text.as_bytes(), &options)
                    .unwrap_or_else(|e| panic!("{e}\n{text}"))
                    .into_log()
                    .unwrap();
                for (k, time_s) in log.time_s().iter().enumerate() {
                    assert_eq!(*time_s, (k as i64 * step) as f64, "{text}");
                }
            }
            // A year of two digits may be any of the parts.
            let short = text.replace("/2024", "/24");
            for (time_unit, read) in [(None, false), (units[1], true)] {
                let options = ReadOptions { time_unit, ..ReadOptions::default() };
                let log = recording_from("a.csv", short.as_bytes(), &options);
                let log = log.and_then(|log| Ok(log.into_log()?));
                match log {
                    Ok(log) => assert!(read && log.time_s()[9] == (9 * step) as f64, "{short}"),
                    Err(said) => {
                        assert!(!read && said.to_string().contains("`dmy` or `mdy`"), "{said}")
                    }
                }
            }
            // One row a day: both orders go on evenly or not, and none of them is shown.
            let (a, b) = (1, rng.random_range(1..12));
            let text = format!("time,u\n{a:02}/{b:02}/2024,1\n{a:02}/{:02}/2024,2\n", b + 1);
            let said = recording_from("a.csv", text.as_bytes(), &ReadOptions::default());
            assert!(said.unwrap_err().to_string().contains("`dmy` or `mdy`"), "{text}");
        }
    }
}
