//! A log of text while it is read.

use super::cell::shown;
use super::clock::{StampReader, shortest};
use super::header::Header;
use super::lines::Lines;
use crate::channels::{Channel, Log, Origin, Rows, Unusable, time_follows};
use crate::error::LogError;
use crate::options::TimeUnit;
use crate::place::{Place, neighbours};

/// Numbers that are read into memory, of all columns together: 3.2 GB.
pub(super) const MOST_NUMBERS: usize = 400_000_000;

/// A log that is being read; its time in the unit of the file until it is whole.
pub(super) struct PartialLog {
    source: String,
    stamps: StampReader,
    pub(super) raw: Vec<f64>,
    columns: Vec<CellColumn>,
    /// Rows with the time of the one before them.
    repeats: Vec<Repeat>,
    /// All stamps so far are whole seconds.
    coarse: bool,
    /// Rows that filled the gaps of the one before them.
    merged: usize,
    rows: Rows,
    /// The shift of the stamps by changes of the clocks, in the unit of the file.
    moved: f64,
    /// Rows that may be read.
    most: usize,
    /// The memory that this is of, where it is the lower limit, bytes.
    memory: Option<u64>,
}

/// A column that is being read: numbers up to the first cell that is none.
#[derive(Default)]
pub(super) struct CellColumn {
    values: Vec<f64>,
    present: Option<Vec<bool>>,
    refused: Option<LogError>,
}

impl CellColumn {
    /// The number in the row before; `Some(None)` where it is missing.
    fn last(&self) -> Option<Option<f64>> {
        let there = self.present.as_ref().is_none_or(|p| p.last() == Some(&true));
        self.values.last().map(|value| there.then_some(*value))
    }

    fn push(&mut self, value: Option<f64>) {
        if value.is_none() && self.present.is_none() {
            self.present = Some(vec![true; self.values.len()]);
        }
        self.values.push(value.unwrap_or(0.0));
        if let Some(present) = &mut self.present {
            present.push(value.is_some());
        }
    }

    fn refuse(&mut self, error: LogError) {
        *self = Self { refused: Some(error), ..Self::default() };
    }
}

/// The numbers of the current line, none of a column that is not read.
type RowOf = Vec<Option<Option<f64>>>;

/// Those of the columns that are read; `None` where one of them holds no number.
fn row_of(
    source: &str,
    lines: &Lines<'_>,
    header: &Header,
    columns: &[CellColumn],
) -> Option<RowOf> {
    let value = |(column, (place, name, _)): (&CellColumn, &(usize, String, Option<String>))| {
        if column.refused.is_some() {
            return Some(None);
        }
        header.number(source, lines, *place, name).ok().map(Some)
    };
    columns.iter().zip(&header.columns).map(value).collect()
}

/// Whether a row has the numbers of the one before it.
fn again(columns: &[CellColumn], row: Option<&[Option<Option<f64>>]>) -> bool {
    row.is_some_and(|row| {
        columns
            .iter()
            .zip(row)
            .all(|(column, value)| value.is_none_or(|value| column.last() == Some(value)))
    })
}

/// Whether a row has numbers only where the one before it has none, and it has one.
fn fills(columns: &[CellColumn], row: &[Option<Option<f64>>]) -> bool {
    let mut any = false;
    let apart = columns.iter().zip(row).all(|(column, value)| {
        let Some(Some(_)) = value else { return true };
        any = true;
        column.last() == Some(None)
    });
    apart && any
}

fn fill(columns: &mut [CellColumn], row: &[Option<Option<f64>>]) {
    for (column, value) in columns.iter_mut().zip(row) {
        if let (Some(Some(value)), Some(last)) = (value, column.values.last_mut()) {
            *last = *value;
            if let Some(there) = column.present.as_mut().and_then(|p| p.last_mut()) {
                *there = true;
            }
        }
    }
}

/// Adds the numbers of the current line.
fn push_row(source: &str, lines: &Lines<'_>, header: &Header, columns: &mut [CellColumn]) {
    let places = columns.iter_mut().zip(&header.columns);
    for (column, (place, name, _)) in places.filter(|(column, _)| column.refused.is_none()) {
        match header.number(source, lines, *place, name) {
            Ok(value) => column.push(value),
            Err(error) => column.refuse(error),
        }
    }
}

/// Rows with rounded stamps, at their even rate, and the step, s. One line goes through all rows where each stays near its stamp, else stamp by stamp.
fn evenly(raw: &[f64], second: f64) -> (Vec<f64>, f64) {
    let at = |k: usize| raw.get(k).copied().unwrap_or(0.0);
    let starts: Vec<usize> =
        (0..raw.len()).filter(|k| k.checked_sub(1).is_none_or(|b| at(b) != at(*k))).collect();
    let stamps: Vec<f64> = starts.iter().map(|k| at(*k)).collect();
    // The unit of the rounding of stamps.
    let unit = neighbours(&stamps).map(|(a, b)| b - a).fold(f64::INFINITY, f64::min);
    if let (Some(first), Some(last)) = (starts.get(1), starts.last())
        && last > first
    {
        let step = (at(*last) - at(*first)) / (last - first) as f64;
        let line = |k: usize| at(*first) + (k as f64 - *first as f64) * step;
        let near = |k: usize| (-0.5 * unit..1.5 * unit).contains(&(line(k) - at(k)));
        if (0..raw.len()).all(near) {
            return ((0..raw.len()).map(line).collect(), step / second);
        }
    }
    let ends = starts.iter().skip(1).copied().chain([raw.len()]);
    let counts: Vec<usize> = starts.iter().zip(ends).map(|(from, to)| to - from).collect();
    let mut sorted = counts.clone();
    sorted.sort_unstable();
    let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(1).max(1);
    let follows = |i: usize| {
        i > 0 && stamps.get(i - 1).zip(stamps.get(i)).is_some_and(|(a, b)| b - a == unit)
    };
    let mut time = Vec::with_capacity(raw.len());
    for (i, (stamp, count)) in stamps.iter().zip(&counts).enumerate() {
        let step = unit / (*count).max(usual) as f64;
        // The rows of an incomplete part behind a gap are the last ones.
        let behind_gap = !follows(i) && follows(i + 1);
        let skipped = if behind_gap { usual.saturating_sub(*count) } else { 0 };
        time.extend((0..*count).map(|j| stamp + (skipped + j) as f64 * step));
    }
    (time, unit / second / usual as f64)
}

/// As many rows for each whole second are stamps that were rounded, on average.
const ROUNDED: f64 = 1.5;

/// A row with the time of the one before it.
struct Repeat {
    /// Its number among the samples.
    at: usize,
    /// As an editor counts it.
    row: usize,
    /// It has the numbers of the row before it.
    same: bool,
}

impl PartialLog {
    pub(super) fn new(source: String, header: &Header, memory: Option<u64>) -> Self {
        let columns = header.columns.iter().map(|_| CellColumn::default()).collect();
        let memory = memory.unwrap_or(u64::MAX);
        let numbers = usize::try_from(memory / size_of::<f64>() as u64).unwrap_or(usize::MAX);
        let most = numbers.min(MOST_NUMBERS) / (header.columns.len() + 1);
        Self {
            source,
            stamps: StampReader::default(),
            raw: Vec::new(),
            columns,
            repeats: Vec::new(),
            coarse: true,
            merged: 0,
            rows: Rows::new(Origin::File),
            moved: 0.0,
            most,
            memory: Some(memory).filter(|_| numbers < MOST_NUMBERS),
        }
    }

    /// The reason why the current line is the rest of a row whose end is lost. Only the last line of a file, below whole rows, can be such a rest.
    pub(super) fn cut_off(&self, lines: &Lines<'_>, header: &Header) -> Option<String> {
        if !lines.open {
            return None;
        }
        if lines.cut_off() {
            return Some(String::new());
        }
        let last = self.raw.last()?;
        if lines.len() < header.cells {
            return Some(format!("{} of {} cells", lines.len(), header.cells));
        }
        if lines.len() > header.cells {
            return None;
        }
        let stamp = header.stamp(&self.source, lines, &mut self.stamps.clone());
        let follows = |stamp: f64| stamp > *last || (self.coarse && stamp == *last);
        if !stamp.is_ok_and(|stamp| follows(stamp - self.moved)) {
            return Some(format!("its time is `{}`", shown(lines.cell(header.time))));
        }
        let columns =
            self.columns.iter().zip(&header.columns).filter(|(column, _)| column.refused.is_none());
        for (column, (place, name, _)) in columns {
            let cell = lines.cell(*place);
            match header.number(&self.source, lines, *place, name) {
                Err(_) => return Some(format!("`{name}` is `{}`", shown(cell))),
                // A column that missed nothing so far, and has lost its last number.
                Ok(None) if *place + 1 == header.cells && column.present.is_none() => {
                    return Some(format!("`{name}` is `{}`", shown(cell)));
                }
                Ok(_) => {}
            }
        }
        None
    }

    /// The refusal of a row beyond the limit.
    fn check_room(&self, row: usize) -> Result<(), LogError> {
        if self.raw.len() < self.most {
            return Ok(());
        }
        let file = self.source.clone();
        if let Some(memory) = self.memory {
            return Err(LogError::Memory { file, limit_mb: memory.div_ceil(1 << 20) });
        }
        let most = self.most as f64 * (self.columns.len() + 1) as f64;
        Err(LogError::TooLarge { file, row, most, gb: most * size_of::<f64>() as f64 / 1e9 })
    }

    /// Adds the current line as a sample.
    pub(super) fn push(&mut self, lines: &Lines<'_>, header: &mut Header) -> Result<(), LogError> {
        header.check_length(lines)?;
        let row = lines.row;
        self.check_room(row)?;
        let Self { source, stamps, raw: before, columns, rows, moved, .. } = self;
        let mut raw = header.stamp(source, lines, stamps)? - *moved;
        // An hourly row that was written twice is one row, in any night.
        let change = stamps.clock_change(before, raw);
        if let Some(change) = change
            && !(before.last() == Some(&raw)
                && again(columns, row_of(source, lines, header, columns).as_deref()))
        {
            (raw, *moved) = (raw - change, *moved + change);
            let way = if change > 0.0 { "forward" } else { "back" };
            header.notes.push(format!(
                "row {row}: local time goes {way} by an hour, as where the clocks are changed; the stamps behind it are moved by that hour"
            ));
        }
        let unit = header.clock.unit.map(|(unit, _)| unit);
        self.coarse &= stamps.is_coarse(raw, unit);
        if before.last() == Some(&raw) {
            let values = row_of(source, lines, header, columns);
            if let Some(values) = values.as_deref().filter(|values| fills(columns, values)) {
                fill(columns, values);
                self.merged += 1;
                return Ok(());
            }
            let same = again(columns, values.as_deref());
            if self.coarse {
                self.repeats.push(Repeat { at: before.len(), row, same });
                rows.note(before.len(), row);
                before.push(raw);
                push_row(source, lines, header, columns);
                return Ok(());
            }
            if same {
                header.twice += 1;
                return Ok(());
            }
        }
        if before.last().is_none_or(|before| *before < raw)
            && raw.abs() <= crate::channels::TIME_LIMIT_S
        {
            rows.note(before.len(), row);
            before.push(raw);
        } else {
            let scale = header.settle(stamps, before).per_second();
            time_follows(
                source,
                || Place::Row(row),
                before.last().map(|t| t / scale),
                raw / scale,
            )?;
        }
        push_row(source, lines, header, columns);
        Ok(())
    }

    /// Leaves out rows that were written twice, where no row repeats a time with other numbers.
    fn drop_twice(&mut self, header: &mut Header) {
        if self.repeats.is_empty() || !self.repeats.iter().all(|r| r.same) {
            return;
        }
        let gone: std::collections::HashSet<usize> = self.repeats.iter().map(|r| r.at).collect();
        fn kept<T: Copy>(values: &[T], gone: &std::collections::HashSet<usize>) -> Vec<T> {
            let there = values.iter().enumerate().filter(|(at, _)| !gone.contains(at));
            there.map(|(_, value)| *value).collect()
        }
        self.raw = kept(&self.raw, &gone);
        for column in self.columns.iter_mut().filter(|column| column.refused.is_none()) {
            column.values = kept(&column.values, &gone);
            column.present = column.present.as_deref().map(|present| kept(present, &gone));
        }
        header.twice += gone.len();
        self.repeats.clear();
    }

    /// Spreads rows whose stamps were rounded to whole seconds.
    ///
    /// # Errors
    /// [`LogError::TimeStandsStill`] where stamps repeat and were not rounded.
    fn spread(&mut self, unit: TimeUnit, header: &mut Header) -> Result<(), LogError> {
        let Some(first) = self.repeats.iter().find(|r| !r.same) else { return Ok(()) };
        let second = unit.per_second();
        let stamps = self.raw.len() - self.repeats.len();
        let whole = second >= 1.0 && self.raw.iter().all(|raw| raw % second == 0.0);
        if !whole || stamps < 3 || (self.raw.len() as f64) < ROUNDED * stamps as f64 {
            let time_s = self.raw.get(first.at).map_or(0.0, |raw| raw / second);
            let place = Place::Row(first.row);
            return Err(LogError::TimeStandsStill { file: self.source.clone(), place, time_s });
        }
        let (time, step_s) = evenly(&self.raw, second);
        header.notes.push(format!(
            "time is in whole seconds, and {} rows have the stamp of the row before them: the rows are spread evenly, one every {} s",
            self.repeats.len(),
            shortest(step_s)
        ));
        self.raw = time;
        Ok(())
    }

    pub(super) fn finish(mut self, header: &mut Header) -> Result<Log, LogError> {
        self.drop_twice(header);
        if header.twice > 0 {
            let twice = std::mem::take(&mut header.twice);
            header.notes.push(format!(
                "{twice} rows are the same as the one before them, with its time; each is read once"
            ));
        }
        if self.merged > 0 {
            header.notes.push(format!(
                "{} rows fill the gaps of the row before them, with its time; each is read together with it",
                self.merged
            ));
        }
        let unit = header.settle(&self.stamps, &self.raw);
        self.spread(unit, header)?;
        let scale = unit.per_second();
        let mut time_s = self.raw;
        if scale != 1.0 {
            time_s.iter_mut().for_each(|t| *t /= scale);
        }
        time_s.shrink_to_fit();
        let (mut channels, mut unusable) = (Vec::new(), Vec::new());
        for (column, (_, name, unit)) in self.columns.drain(..).zip(&header.columns) {
            if let Some(error) = column.refused {
                unusable.push(Unusable { name: name.clone(), error });
                continue;
            }
            let CellColumn { mut values, mut present, .. } = column;
            values.shrink_to_fit();
            present.iter_mut().for_each(Vec::shrink_to_fit);
            channels.push(Channel {
                name: name.clone(),
                unit: unit.clone(),
                values: values.into(),
                present,
            });
        }
        Log::assemble(self.source, time_s, channels, unusable, self.rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::ReadOptions;

    #[test]
    fn rows_beyond_the_limit_are_refused() {
        let mut lines = Lines::new("a.csv", "time,u\n0,1\n1,2\n2,3\n".as_bytes()).unwrap();
        let mut header = Header::read(&mut lines, &ReadOptions::default()).unwrap();
        let mut part = PartialLog::new("a.csv".into(), &header, None);
        assert_eq!(part.most, MOST_NUMBERS / 2);
        part.most = 2;
        for _ in 0..2 {
            assert!(lines.next().unwrap());
            part.push(&lines, &mut header).unwrap();
        }
        assert!(lines.next().unwrap());
        let said = part.push(&lines, &mut header).unwrap_err().to_string();
        assert!(said.starts_with("a.csv, row 4: more than 4e0 numbers"), "{said}");
    }

    #[test]
    fn stamps_in_whole_seconds_are_spread_over_them() {
        use crate::csv::table::recording_from;
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(41);
        for round in 0..60 {
            let (rate, start) = (rng.random_range(2..50) as f64, rng.random_range(0.0..1.0));
            let dated = round % 2 == 0;
            let gap = if round % 3 == 0 { 7.0 } else { 0.0 };
            let mut text = if dated { "timestamp,u\n" } else { "time,u\n" }.to_owned();
            let mut truth = Vec::new();
            for k in 0..400 {
                let at = start + f64::from(k) / rate + if k > 200 { gap } else { 0.0 };
                truth.push(at);
                let s = at.floor() as i64;
                // A number that is constant for some rows, as slow sensors give it.
                let stamp = if dated {
                    format!("2024-03-05 10:{:02}:{:02}", s / 60, s % 60)
                } else {
                    s.to_string()
                };
                text += &format!("{stamp},{}\n", k / 3);
            }
            let read = recording_from("a.csv", text.as_bytes(), &ReadOptions::default()).unwrap();
            let notes = read.notes.join("|");
            assert!(notes.contains("spread evenly"), "{notes}");
            let log = read.into_log().unwrap();
            assert_eq!(log.len(), 400, "{notes}");
            let off: Vec<f64> = log.time_s().iter().zip(&truth).map(|(t, at)| t - at).collect();
            let (low, high) = off
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
            // A second has a row more or less than the rate.
            let most = if gap > 0.0 { 4.0 } else { 2.0 } / rate;
            assert!(high - low < most, "{rate}: {low} to {high}");
        }
    }

    #[test]
    fn a_file_without_a_header_row_asks_for_names_and_takes_them() {
        use crate::csv::table::recording_from;
        for by in [",", ";", "\t", " "] {
            let text: String = (0..50)
                .map(|k| format!("{:.1}{by}{k}{by}{}\n", 0.1 * f64::from(k), k % 3))
                .collect();
            let said =
                recording_from("a.csv", text.as_bytes(), &ReadOptions::default()).unwrap_err();
            assert!(said.to_string().contains("`columns`"), "{said}");
            let names = ["time", "speed [m/s]", "u"].map(str::to_owned).to_vec();
            let options = ReadOptions { columns: names, ..ReadOptions::default() };
            let log =
                recording_from("a.csv", text.as_bytes(), &options).unwrap().into_log().unwrap();
            assert_eq!((log.len(), log.input("speed").unwrap()[49]), (50, 49.0), "{by}");
            let few =
                ReadOptions { columns: vec!["time".into(), "u".into()], ..ReadOptions::default() };
            assert!(recording_from("a.csv", text.as_bytes(), &few).is_err());
        }
    }
}
