//! A match by frequency as text.

use super::structured::{digits, fitted, not_identifiable, standing};
use super::text::Table;
use deadtime_identify::matching::{Gain, Matched};
use deadtime_identify::structured::Standing;

/// Parameters with intervals, the distance of the responses, and the combinations that are not identifiable.
#[must_use]
pub fn text(found: &Matched) -> String {
    let mut text = format!("{} to {} {}.\n\n", found.structure, found.identified, how(found));
    let mut table = Table::new(
        &["parameter", "unit", "file", "found", "95 % interval", "standing"],
        &[0, 1, 5],
    );
    for p in &found.parameters {
        let (value, ends) = fitted(p.value, p.interval);
        table.row(vec![
            p.name.clone(),
            p.unit.clone().unwrap_or_default(),
            digits(p.nominal),
            value,
            ends.map_or_else(|| "-".to_owned(), |ends| ends.join(" to ")),
            standing(p.standing).to_owned(),
        ]);
    }
    text += &table.to_string();
    for said in meanings(found) {
        text += &format!("\n{said}\n");
    }
    text += &not_identifiable(&found.unseen, &found.trades);
    text += &format!("\n{}\n", nearness(found).join("\n"));
    for note in &found.notes {
        text += &format!("note: {note}\n");
    }
    text
}

/// By what, where, and how the search ended.
pub(super) fn how(found: &Matched) -> String {
    let [low, high] = found.band_rad_s;
    let time = found
        .sample_time_s
        .map_or_else(|| "in continuous time".to_owned(), |ts| format!("sampled at {ts} s"));
    let [starts, alike] = found.starts;
    let held = found.prior.map_or_else(String::new, |spread| {
        format!(
            "; the file's values are held within {:.0} % (one standard deviation)",
            100.0 * spread
        )
    });
    format!(
        "by {}, {time}: {} frequencies from {} to {} rad/s{held}; {alike} of {starts} starts ended at the lowest minimum",
        found.norm,
        found.frequencies,
        digits(low),
        digits(high)
    )
}

/// The meanings of the standings that some parameter has and that a reader must know.
pub(super) fn meanings(found: &Matched) -> Vec<&'static str> {
    let all = [
        (
            Standing::Surrogate,
            "surrogate: a nominal value moved tenfold; it follows the response, but it is not that quantity.",
        ),
        (
            Standing::Open,
            "open: the response does not fix it: its interval holds 0, or it is correlated with another parameter.",
        ),
        (
            Standing::Held,
            "held: the response does not fix it; a prior keeps it near the file's value.",
        ),
    ];
    all.into_iter()
        .filter(|(of, _)| found.parameters.iter().any(|p| p.standing == *of))
        .map(|(_, said)| said)
        .collect()
}

/// How near the two models came, a line each.
pub(super) fn nearness(found: &Matched) -> Vec<String> {
    let [before, after] = found.difference;
    let gain = |g: &Gain| {
        format!(
            "{} at {} rad/s{}",
            digits(g.gain),
            digits(g.omega_rad_s),
            if g.exact { "" } else { " (on the grid)" }
        )
    };
    let [first, last] = &found.largest_gain;
    let [identified, structured] = found.unstable_poles;
    let gap = found.nu_gap.map_or_else(|| "without a value".to_owned(), |g| digits(g.value));
    let m = &found.misfit;
    let size = if found.uncertainty {
        format!("{:.1} standard deviations", m.size)
    } else {
        format!("{:.2} % of the magnitude", 100.0 * m.size)
    };
    vec![
        format!(
            "Difference by {}, file → found: {} → {}",
            found.norm,
            digits(before),
            digits(after)
        ),
        format!("Largest gain of the difference: {} → {}", gain(first), gain(last)),
        format!(
            "Nu-gap of the two models: {gap}; unstable poles: {identified} identified, {structured} structured"
        ),
        format!(
            "Farthest apart: {} to {} at {} rad/s, {size}",
            m.input,
            m.output,
            digits(m.omega_rad_s)
        ),
    ]
}
