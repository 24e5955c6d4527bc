//! Numbers that mean a missing sample: −9999, 65535 and the like.

use deadtime_signal::remedy::{Message, Remedy};

use super::channels::{Channel, Log};
use crate::notes::Notes;

/// The numbers that recorders write where they have none.
const KNOWN: [f64; 19] = [
    -999_999.0,
    -99_999.0,
    -32_768.0,
    -32_767.0,
    -9_999.0,
    -999.25,
    -999.0,
    -99.0,
    255.0,
    999.0,
    9_999.0,
    32_767.0,
    65_535.0,
    99_999.0,
    999_999.0,
    2_147_483_647.0,
    -2_147_483_648.0,
    4_294_967_295.0,
    -1_000_000.0,
];
/// The least count of a number in a channel for such a meaning.
const OFTEN: usize = 3;
/// As many times the spread of all others it must be away from them.
const FAR: f64 = 5.0;

/// Takes the numbers that the caller names for missing, and names those that look like it.
pub(super) fn missing(log: &mut Log, given: &[f64], notes: &mut Notes) {
    for channel in &mut log.channels {
        let gone = given.iter().map(|number| taken(channel, *number)).sum::<usize>();
        if gone > 0 {
            notes.push(format!(
                "{}: {gone} samples are missing, by the numbers that stand for them",
                channel.name
            ));
        }
        if let Some((number, count)) = suspected(channel) {
            let name = &channel.name;
            let what = format!(
                "{name}: {number} stands there {count} times, far from all other values: if it means that a sample is missing, give "
            );
            notes.push(Message::from(what).and(Remedy::Missing { number }));
        }
    }
}

/// A value is the number, or the number in single precision.
fn is_number(value: f64, number: f64) -> bool {
    value == number || value == f64::from(number as f32)
}

/// Makes the samples with one number missing; their count.
fn taken(channel: &mut Channel, number: f64) -> usize {
    let stands = |v: Option<f64>| v.is_some_and(|v| is_number(v, number));
    let places: Vec<usize> =
        channel.iter().enumerate().filter(|(_, v)| stands(*v)).map(|(at, _)| at).collect();
    if places.is_empty() {
        return 0;
    }
    let length = channel.iter().count();
    let present = channel.present.get_or_insert_with(|| vec![true; length]);
    for at in &places {
        if let Some(there) = present.get_mut(*at) {
            *there = false;
        }
        channel.values.clear(*at);
    }
    places.len()
}

/// The known number that is far from all others of a channel, and its count.
fn suspected(channel: &Channel) -> Option<(f64, usize)> {
    let (mut low, mut high, mut counts) =
        (f64::INFINITY, f64::NEG_INFINITY, [0_usize; KNOWN.len()]);
    for value in channel.iter().flatten() {
        match KNOWN.iter().zip(&mut counts).find(|(known, _)| is_number(value, **known)) {
            Some((_, count)) => *count += 1,
            None => (low, high) = (low.min(value), high.max(value)),
        }
    }
    // One value has no spread.
    let spread = Some(high - low).filter(|spread| *spread > 0.0)?;
    let far = |known: f64| known < low - FAR * spread || known > high + FAR * spread;
    KNOWN
        .into_iter()
        .zip(counts)
        .filter(|(known, count)| *count >= OFTEN && far(*known))
        .max_by_key(|(_, count)| *count)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use crate::csv::table::recording_from;
    use crate::{ReadOptions, open};

    #[test]
    fn numbers_far_from_all_others_are_named_and_taken_for_missing_when_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(21);
        for sentinel in [-9_999.0, -999.25, 65_535.0, 9_999.0, -32_768.0] {
            let (mut text, mut gone) = ("time,u,y\n".to_owned(), 0);
            for k in 0..300 {
                let lost = rng.random_bool(0.1);
                gone += usize::from(lost);
                let y = if lost { sentinel } else { rng.random_range(-2.0..30.0) };
                text += &format!("{k},{},{y}\n", k % 7);
            }
            std::fs::write(&path, &text).unwrap();
            let said = open(&path, &ReadOptions::default()).unwrap().notes.join("|");
            assert!(
                said.contains(&format!("y: {sentinel} stands there {gone} times"))
                    && !said.contains("u: "),
                "{said}"
            );
            let options = ReadOptions { missing: vec![sentinel], ..ReadOptions::default() };
            let read = open(&path, &options).unwrap();
            let samples = read.topics[0].log.channel("y").unwrap().samples();
            assert_eq!((0..300).filter(|k| samples.get(*k).is_none()).count(), gone);
            assert!(read.notes.join("|").contains(&format!("y: {gone} samples are missing")));
        }
    }

    #[test]
    fn what_a_channel_reaches_is_no_sentinel() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(22);
        for _ in 0..30 {
            // Counts of eight and sixteen bits that reach their ends, and constants.
            let mut text = "time,a,b,c\n".to_owned();
            for k in 0..300 {
                text += &format!(
                    "{k},{},{},255\n",
                    rng.random_range(100..256),
                    rng.random_range(40_000..65_536)
                );
            }
            let said =
                recording_from("a.csv", text.as_bytes(), &ReadOptions::default()).unwrap().notes;
            assert!(!said.join("|").contains("stands there"), "{said:?}");
        }
    }
}
