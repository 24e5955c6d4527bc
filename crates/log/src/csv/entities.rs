//! Tables of one row an event, as building automation exports them: who, its state, and when.
//!
//! How it can be wrong: a table of several channels with a channel `value` and a column of names is no such table. Only a table of three kinds of columns is.

use std::collections::BTreeMap;

use super::cell::{Cell, parse};
use super::clock::StampReader;
use super::header::{Columns, Header};
use super::lines::Lines;
use crate::budget::Budget;
use crate::error::Error;
use crate::options::ReadOptions;
use crate::recording::{Recording, Table, Topic};

/// The possible names of the column of names.
const WHO: [&str; 20] = [
    "entity_id",
    "entity",
    "signal",
    "channel",
    "tag",
    "variable",
    "metric",
    "point",
    "register",
    "sensor",
    "item",
    "name",
    "topic",
    "device",
    "device_id",
    "object_id",
    "parameter",
    "kanal",
    "_field",
    "field",
];
/// The possible names of the column of values.
const WHAT: [&str; 7] = ["state", "value", "val", "reading", "wert", "messwert", "_value"];
/// Columns besides these, such as units and attributes.
const MORE: [&str; 13] = [
    "unit",
    "unit_of_measurement",
    "quality",
    "attributes",
    "source",
    "type",
    "friendly_name",
    "domain",
    // Of InfluxDB.
    "result",
    "table",
    "_start",
    "_stop",
    "_measurement",
];
/// Entities at most.
const MOST: usize = 4096;
/// The values of an entity without a state.
const NONE: [&str; 2] = ["unknown", "unavailable"];

/// The columns of such a table.
pub(super) struct Entities {
    who: usize,
    what: usize,
    name: String,
}

/// Stamps and values of one entity.
type Events = (Vec<f64>, Vec<Option<f64>>);

/// Rows while they are read.
#[derive(Default)]
struct Rows {
    /// For each entity its stamps in the unit of the file, and its values.
    of: BTreeMap<Vec<u8>, Events>,
    /// Entities whose states are text.
    text: BTreeMap<Vec<u8>, usize>,
}

impl Entities {
    /// The columns of names and of values; `None` for any other table.
    pub(super) fn of(header: &Header) -> Option<Self> {
        let columns: &Columns = &header.columns;
        let find = |known: &[&str]| {
            columns.iter().find(|(_, name, _)| known.contains(&name.trim().to_lowercase().as_str()))
        };
        let ((who, ..), (what, name, _)) = (find(&WHO)?, find(&WHAT)?);
        let rest = columns.iter().filter(|(place, ..)| place != who && place != what);
        let known = |name: &str| MORE.contains(&name.trim().to_lowercase().as_str());
        rest.into_iter().all(|(_, name, _)| known(name)).then(|| Self {
            who: *who,
            what: *what,
            name: name.clone(),
        })
    }

    /// One channel for each entity, with its own stamps.
    pub(super) fn read(
        &self,
        source: &str,
        mut lines: Lines<'_>,
        mut header: Header,
        options: &ReadOptions,
    ) -> Result<Recording, Error> {
        let (mut stamps, mut rows) = (StampReader::default(), Rows::default());
        let mut all = Vec::new();
        while lines.next()? {
            if !header.wants(&lines) || (lines.open && lines.len() < header.cells) {
                continue;
            }
            header.check_length(&lines)?;
            let raw = header.stamp(source, &lines, &mut stamps)?;
            all.push(raw);
            rows.push(lines.cell(self.who), lines.cell(self.what), raw, header.decimal_comma);
        }
        header.notes.extend(lines.how_it_ends());
        if all.is_empty() {
            return Err(lines.nothing(header.no_rows(source)).into());
        }
        all.sort_by(f64::total_cmp);
        let scale = header.settle(&stamps, &all).per_second();
        let budget = Budget::new(options.memory.unwrap_or(u64::MAX));
        let mut notes = header.notes;
        let topics = rows.topics(source, &self.name, scale, &budget, &mut notes)?;
        notes.push(format!("one row is one event: each of {} entities is a channel", topics.len()));
        Recording::of_topics(source, ("csv", "a table of events"), topics, notes)
    }
}

impl Rows {
    fn push(&mut self, who: &[u8], what: &[u8], raw: f64, decimal_comma: bool) {
        let who = who.trim_ascii();
        let none = std::str::from_utf8(what)
            .is_ok_and(|text| NONE.iter().any(|none| text.trim().eq_ignore_ascii_case(none)));
        let value = match parse(what, decimal_comma) {
            Cell::Number(x) => Some(x),
            Cell::Missing => None,
            _ if none => None,
            _ => {
                *self.text.entry(who.to_vec()).or_insert(0) += 1;
                return;
            }
        };
        if self.of.len() < MOST || self.of.contains_key(who) {
            let (times, values) = self.of.entry(who.to_vec()).or_default();
            times.push(raw);
            values.push(value);
        }
    }

    fn topics(
        self,
        source: &str,
        name: &str,
        scale: f64,
        budget: &Budget,
        notes: &mut crate::notes::Notes,
    ) -> Result<Vec<Topic>, Error> {
        let mut topics = Vec::with_capacity(self.of.len());
        for (who, (times, values)) in self.of {
            if self.text.contains_key(&who) {
                continue;
            }
            let mut table = Table::new(name).within(budget);
            let column = table.column(String::from_utf8_lossy(&who), None);
            for (time, value) in times.iter().zip(values) {
                // An event without a state ends none: the one before is kept.
                if let Some(value) = value {
                    table.row(time / scale);
                    table.set(column, value);
                }
            }
            topics.extend(table.finish(source, notes)?);
        }
        if !self.text.is_empty() {
            let names: Vec<_> =
                self.text.keys().take(6).map(|who| String::from_utf8_lossy(who)).collect();
            notes.push(format!("states that are text are left out: {}", names.join(", ")));
        }
        Ok(topics)
    }
}

#[cfg(test)]
mod tests {
    use crate::align::Wanted;
    use crate::csv::table::recording_from;
    use crate::options::ReadOptions;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn one_row_an_event_is_read_as_a_channel_for_each_entity() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(35);
        for round in 0..40 {
            let header = [
                ["entity_id,state,last_changed", "time,tag,value"],
                ["device,reading,time", "Zeit,Name,Wert"],
                ["topic,value,timestamp", "_time,_field,_value"],
            ][round % 3][round % 2];
            let mut events: Vec<(i64, &str, String)> = Vec::new();
            for k in 0..200_i64 {
                let at = 60 * k + rng.random_range(0..20);
                events.push((at, "sensor.temp", format!("{}.5", k)));
                if k % 7 == 0 {
                    events.push((
                        at + 5,
                        "switch.boiler",
                        if k % 2 == 0 { "on" } else { "off" }.into(),
                    ));
                    events.push((at + 6, "sun.sun", "above_horizon".into()));
                }
                if k % 50 == 3 {
                    events.push((at + 7, "sensor.temp", "unavailable".into()));
                }
            }
            // By entity, or by time.
            events.sort_by_key(|(at, who, _)| if round % 3 == 0 { (*who, *at) } else { ("", *at) });
            let mut text = format!("{header}\n");
            for (at, who, state) in &events {
                let clock =
                    format!("2024-03-05T{:02}:{:02}:{:02}Z", at / 3600, at / 60 % 60, at % 60);
                text += &match round % 2 {
                    0 => format!("{who},{state},{clock}\n"),
                    _ => format!("{clock},{who},{state}\n"),
                };
            }
            let options = ReadOptions { ..ReadOptions::default() };
            let read = recording_from("a.csv", text.as_bytes(), &options).unwrap();
            assert_eq!(read.topics.len(), 2, "{:?}", read.notes);
            assert!(read.notes.join("|").contains("left out: sun.sun"), "{:?}", read.notes);
            let temp = read.channel("sensor.temp").unwrap();
            assert_eq!((temp.0.log.len(), temp.1.samples().get(3)), (200, Some(3.5)));
            let wanted = [("switch.boiler", true), ("sensor.temp", false)]
                .map(|(name, held)| Wanted { name: name.into(), held, required: true });
            assert!(read.together(&wanted, None).unwrap().0.input("switch.boiler").is_ok());
        }
    }
}
