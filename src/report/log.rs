//! The listing of a log for a terminal.

use super::text::Table;
use deadtime_log::{ChannelListing, Listing, TopicListing};

/// Eighths of a line's height.
const BLOCKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// Topics and channels as text: one line a topic, a table of its channels.
#[must_use]
pub fn text(listing: &Listing) -> String {
    let channels: usize = listing.topics.iter().map(|t| t.channels.len()).sum();
    let topics = listing.topics.iter().filter(|t| !t.name.is_empty()).count();
    let held = if topics > 0 {
        format!("{topics} topics, {channels} channels")
    } else {
        format!("{channels} channels")
    };
    let mut text = format!("{}: {}, {held}\n", listing.file, listing.reader);
    for note in listing.notes.iter() {
        text += &format!("note: {note}\n");
    }
    for topic in &listing.topics {
        text += &format!("\n{}\n{}", about(topic), table(topic));
        if !topic.not_numbers.is_empty() {
            text += &format!("  no numbers: {}\n", topic.not_numbers.join(", "));
        }
    }
    text
}

fn about(topic: &TopicListing) -> String {
    let name = if topic.name.is_empty() { String::new() } else { format!("{}: ", topic.name) };
    let mut text = format!(
        "{name}{} samples, {} s to {} s",
        topic.samples,
        number(topic.from_s),
        number(topic.to_s)
    );
    if let (Some(step_s), Some(jitter_s)) = (topic.step_s, topic.jitter_s) {
        text += &format!(
            ", {} Hz (median step {} s, {})",
            number(1.0 / step_s),
            number(step_s),
            if topic.even {
                "even".to_owned()
            } else {
                format!("uneven by {} s", number(jitter_s))
            }
        );
    }
    let longest =
        topic.gaps.iter().max_by(|a, b| (a.to_s - a.from_s).total_cmp(&(b.to_s - b.from_s)));
    if let Some(gap) = longest {
        let s = if topic.gap_count == 1 { "" } else { "s" };
        text += &format!(
            ", {} gap{s} (for instance {} s at {} s)",
            topic.gap_count,
            number(gap.to_s - gap.from_s),
            number(gap.from_s)
        );
    }
    text
}

fn table(topic: &TopicListing) -> String {
    let mut table =
        Table::new(&["channel", "unit", "min", "max", "mean", "missing", "course"], &[0, 1, 6]);
    for channel in &topic.channels {
        let shown = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), number);
        table.row(vec![
            channel.name.clone(),
            channel.unit.clone().unwrap_or_default(),
            shown(channel.min),
            shown(channel.max),
            shown(channel.mean),
            if channel.missing > 0 { channel.missing.to_string() } else { String::new() },
            course(channel),
        ]);
    }
    table.to_string()
}

/// The course of a channel between its smallest and its largest part; a blank where nothing was logged.
fn course(channel: &ChannelListing) -> String {
    let there = || channel.course.iter().flatten().copied();
    let (low, high) =
        (there().fold(f64::INFINITY, f64::min), there().fold(f64::NEG_INFINITY, f64::max));
    let block = |x: f64| {
        // Halves, as the difference of the largest numbers has no room in f64.
        let share = if high > low { (x / 2.0 - low / 2.0) / (high / 2.0 - low / 2.0) } else { 0.0 };
        BLOCKS.get((share * 8.0) as usize).copied().unwrap_or('█')
    };
    channel.course.iter().map(|x| x.map_or(' ', block)).collect()
}

/// Six digits, powers of ten where they are shorter.
pub(super) fn number(x: f64) -> String {
    let rounded: f64 = format!("{x:.5e}").parse().unwrap_or(x);
    let size = rounded.abs();
    if size == 0.0 {
        "0".to_owned()
    } else if (1e-4..1e10).contains(&size) {
        format!("{rounded}")
    } else {
        format!("{rounded:e}")
    }
}
