//! Merged tables, each of whose topics has numbers in its own rows only.
//!
//! How it can be wrong: columns of one topic that miss other samples each are taken for several topics, which changes no number of theirs.

use crate::channels::{Channel, Log, Origin, Rows};
use crate::recording::Topic;

/// Share of rows with all columns from which a table is one log.
const WHOLE: f64 = 0.5;

/// The topics of a table in which no column is whole and most rows lack some: columns with numbers in the same rows belong together.
pub(super) fn apart(log: &Log) -> Option<Vec<Topic>> {
    let masks: Vec<&Vec<bool>> =
        log.channels.iter().map(|c| c.present.as_ref()).collect::<Option<_>>()?;
    let rows = log.time_s.len();
    let there = |k: usize| masks.iter().all(|mask| mask.get(k) == Some(&true));
    if masks.len() < 2 || (0..rows).filter(|k| there(*k)).count() as f64 > WHOLE * rows as f64 {
        return None;
    }
    let mut groups: Vec<(&Vec<bool>, Vec<&Channel>)> = Vec::new();
    for (channel, mask) in log.channels.iter().zip(&masks) {
        // A column without any number is none of a topic.
        if !mask.contains(&true) {
            continue;
        }
        match groups.iter_mut().find(|(of, _)| of == mask) {
            Some((_, channels)) => channels.push(channel),
            None => groups.push((mask, vec![channel])),
        }
    }
    if groups.len() < 2 {
        return None;
    }
    groups.iter().map(|(mask, channels)| topic(log, mask, channels)).collect()
}

/// The rows of one topic.
fn topic(log: &Log, mask: &[bool], channels: &[&Channel]) -> Option<Topic> {
    let places: Vec<usize> =
        mask.iter().enumerate().filter(|(_, there)| **there).map(|(at, _)| at).collect();
    let time_s = places.iter().filter_map(|at| log.time_s.get(*at).copied()).collect();
    let own = channels.iter().map(|channel| Channel {
        name: channel.name.clone(),
        unit: channel.unit.clone(),
        values: channel.values.numbers().picked(&places).into(),
        present: None,
    });
    let name = channels.first().map_or_else(String::new, |channel| channel.name.clone());
    let source = format!("{}:{name}", log.source);
    let log =
        Log::assemble(source, time_s, own.collect(), Vec::new(), Rows::new(Origin::Memory)).ok()?;
    Some(Topic { name, log })
}

#[cfg(test)]
mod tests {
    use crate::align::Wanted;
    use crate::csv::table::recording_from;
    use crate::options::ReadOptions;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_merged_table_is_read_as_its_topics() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(33);
        for _ in 0..60 {
            let (slow, shift) = (rng.random_range(2..6_u64), rng.random_range(1..9_u64));
            let mut rows: Vec<(u64, String)> = Vec::new();
            for k in 0..400 {
                rows.push((10 * k, format!(",,{},{}", k, 2 * k)));
                if k % slow == 0 {
                    // At times in the same row as the other topic.
                    let at = if rng.random_bool(0.2) { 10 * k } else { 10 * k + shift };
                    rows.push((at, format!("{},{},,", k, k + 1)));
                }
            }
            rows.sort_by_key(|(at, _)| *at);
            let mut text = "time,cmd,cmd_2,y,y_2\n".to_owned();
            for (at, row) in &rows {
                text += &format!("{},{row}\n", *at as f64 / 1000.0);
            }
            let read = recording_from("a.csv", text.as_bytes(), &ReadOptions::default()).unwrap();
            assert_eq!(read.topics.len(), 2, "{:?}", read.notes);
            assert!(read.notes.join("|").contains("topics with stamps of their own"));
            let wanted = [("cmd", true), ("y", false)].map(|(name, held)| Wanted {
                name: name.into(),
                held,
                required: true,
            });
            let (log, _) = read.together(&wanted, None).unwrap();
            assert!(log.input("cmd").is_ok() && log.len() > 50, "{}", log.len());
        }
        // An output that misses most samples of a complete input belongs to one log.
        let mut text = "time,u,y\n".to_owned();
        for k in 0..300 {
            text += &format!("{k},{k},{}\n", if k % 5 == 0 { "1" } else { "" });
        }
        let read = recording_from("a.csv", text.as_bytes(), &ReadOptions::default()).unwrap();
        assert_eq!(read.topics.len(), 1);
    }
}
