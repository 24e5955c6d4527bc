//! Time stamps of a file as seconds: their unit and their origin.

use super::date::{DAY_NS, HOUR_NS, all_digits, clock_only, date, zoned};
use super::slashes::{Slashes, is_date, written};
use crate::options::TimeUnit;
use crate::place::neighbours;
use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::stats;

/// Whole numbers beyond this are counted from the first stamp, so that differences of nanoseconds since 1970 keep every digit; seconds since 1970 are, too.
const COUNTED_FROM_FIRST: i128 = 100_000_000_000;
/// Seconds since 1970 at the beginning of 2000 and of 2100: whole numbers between them are dates in seconds, and so on for thousandths.
const DATES_S: std::ops::Range<f64> = 946_684_800.0..4_102_444_800.0;
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

/// Days since 1900 that a spreadsheet counts from 1982 to 2064.
const SPREADSHEET_DAYS: std::ops::Range<f64> = 30_000.0..60_000.0;

/// Whether stamps are days as a spreadsheet counts them: of our days, with whole seconds between them that are no short decimals of a day.
fn spreadsheet(size: f64, step: f64) -> bool {
    let (step_s, tenthousandths) = (step * 86_400.0, step * 1e4);
    let whole = step_s.round() >= 1.0 && (step_s - step_s.round()).abs() <= 1e-3 * step_s.round();
    let decimal = (tenthousandths - tenthousandths.round()).abs() <= 1e-3;
    SPREADSHEET_DAYS.contains(&size) && step < 1.0 && whole && !decimal
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
/// To four digits, as short as it goes.
pub(super) fn shortest(x: f64) -> f64 {
    format!("{x:.3e}").parse().unwrap_or(x)
}
#[cfg(test)]
mod tests {
    use super::super::date::days;
    use super::*;

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
