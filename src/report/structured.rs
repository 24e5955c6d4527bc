//! A structured fit as text.

use super::text::{Table, estimate};
use deadtime_identify::structured::{GroupScore, Standing, StructuredFit, Unseen};
use deadtime_signal::stats::NORMAL_95;

/// Horizons that a table shows.
fn shown(horizon: usize) -> Vec<usize> {
    let mut list: Vec<usize> =
        [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].into_iter().filter(|h| *h < horizon).collect();
    list.push(horizon);
    list
}

/// Mean absolute errors by group and horizon; several lists of the same groups are next to each other as "from → to".
#[must_use]
pub fn scores(name: &str, lists: &[&[GroupScore]]) -> String {
    let horizon = lists.first().and_then(|l| l.first()).map_or(0, |g| g.mean_absolute.len());
    let heads: Vec<String> = shown(horizon).iter().map(|h| format!("h = {h}")).collect();
    let mut headings = vec!["group"];
    headings.extend(heads.iter().map(String::as_str));
    headings.push("sum");
    let mut table = Table::new(&headings, &[0]);
    for (i, group) in lists.first().copied().unwrap_or(&[]).iter().enumerate() {
        let cell = |f: &dyn Fn(&GroupScore) -> f64| {
            let each: Vec<String> =
                lists.iter().filter_map(|l| l.get(i)).map(|g| number(f(g))).collect();
            each.join(" → ")
        };
        let unit = group.unit.as_ref().map_or(String::new(), |u| format!(" [{u}]"));
        let mut row = vec![format!("{}{unit}", group.group)];
        row.extend(
            shown(horizon)
                .iter()
                .map(|&h| cell(&|g| g.mean_absolute.get(h - 1).copied().unwrap_or(f64::NAN))),
        );
        row.push(cell(&|g| g.sum));
        table.row(row);
    }
    format!("Mean absolute errors of {name}, h steps after a window's start:\n{table}")
}

fn number(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || (1e-3..1e4).contains(&size) {
        format!("{value:.4}")
    } else {
        format!("{value:.3e}")
    }
}

/// Four digits, at any size.
pub(super) fn digits(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let exponent = value.abs().log10().floor();
    if (-4.0..5.0).contains(&exponent) {
        format!("{value:.*}", (3.0 - exponent).max(0.0) as usize)
    } else {
        format!("{value:.3e}")
    }
}

/// A value and the ends of its interval with the digits that the interval allows.
pub(super) fn fitted(value: f64, interval: Option<[f64; 2]>) -> (String, Option<[String; 2]>) {
    match interval.filter(|ends| ends.iter().all(|v| v.is_finite()) && ends[1] > ends[0]) {
        Some(ends) => estimate(value, Some(ends)),
        None => (digits(value), interval.map(|ends| ends.map(digits))),
    }
}

/// The meaning of a standing that some parameter has and that a reader must know.
pub(super) fn meaning(found: &StructuredFit, standing: Standing) -> Option<&'static str> {
    let said = match standing {
        Standing::Surrogate => {
            "surrogate: it predicts, but its value is not physical: fits over one and over many steps differ twofold, or a nominal value moved tenfold."
        }
        Standing::Open => {
            "open: these logs do not determine it: its interval holds 0, or it is correlated with another parameter."
        }
        Standing::Unchecked if found.parameters.iter().any(|p| p.one_step.is_some()) => {
            "unchecked: no evidence contradicts it, but single steps fix its value too loosely to confirm it."
        }
        Standing::Physical | Standing::Unchecked | Standing::Held => return None,
    };
    found.parameters.iter().any(|p| p.standing == standing).then_some(said)
}

/// The number of parameters that the logs determine.
pub(super) fn determined(found: &StructuredFit) -> String {
    format!(
        "The logs determine {:.1} of {} parameters; shrinkage towards the file's values determines the rest.",
        found.determined,
        found.parameters.len()
    )
}

/// A standing as a word.
pub(super) fn standing(of: Standing) -> &'static str {
    match of {
        Standing::Physical => "physical",
        Standing::Surrogate => "surrogate",
        Standing::Unchecked => "unchecked",
        Standing::Open => "open",
        Standing::Held => "held",
    }
}

/// Parameters with intervals, the combinations that are not identifiable, and the errors before and after.
#[must_use]
pub fn text(found: &StructuredFit) -> String {
    let mut text = format!(
        "{}: {} parameters over {} windows of {} steps of {} s ({} clusters, {} Runge-Kutta step{} a sample). {}{}\n\n",
        found.name,
        found.parameters.len(),
        found.windows,
        found.horizon,
        found.sample_time_s,
        found.clusters,
        found.substeps,
        if found.substeps == 1 { "" } else { "s" },
        determined(found),
        if found.converged { "" } else { " The search did not end at a minimum." }
    );
    let mut table = Table::new(
        &["parameter", "unit", "file", "found", "95 % interval", "one step ahead", "standing"],
        &[0, 1, 6],
    );
    for p in &found.parameters {
        let (value, ends) = fitted(p.value, Some(p.interval));
        table.row(vec![
            p.name.clone(),
            p.unit.clone().unwrap_or_default(),
            digits(p.nominal),
            value,
            ends.map_or_else(|| "-".to_owned(), |ends| ends.join(" to ")),
            p.one_step.map_or(String::new(), |[v, s]| {
                format!("{} ± {}", digits(v), digits(NORMAL_95 * s))
            }),
            standing(p.standing).to_owned(),
        ]);
    }
    text += &table.to_string();
    for said in [Standing::Surrogate, Standing::Open, Standing::Unchecked]
        .into_iter()
        .filter_map(|s| meaning(found, s))
    {
        text += &format!("\n{said}\n");
    }
    text += &not_identifiable(&found.unseen, &found.trades);
    for (name, record, value) in &found.per_record {
        text += &format!("\n{name} stands off by {} in {record}", digits(*value));
    }
    if !found.per_record.is_empty() {
        text += "\n";
    }
    let [before, after] = &found.training;
    text += "\nOn the training logs, file → fitted. ";
    text += &scores(&found.name, &[before, after]);
    if let Some([before, after]) = &found.held_out {
        text += "\nOn the logs held out, file → fitted. ";
        text += &scores(&found.name, &[before, after]);
    }
    text
}
/// The combinations that are not identifiable and the correlated ones, a line each.
pub(super) fn not_identifiable(unseen: &[Unseen], trades: &[String]) -> String {
    let mut text = String::new();
    for unseen in unseen {
        text += &format!(
            "\nNot identifiable: {} (standard deviation {}).",
            unseen.words,
            how_unseen(unseen.std)
        );
    }
    for trade in trades {
        text += &format!("\n{trade}.");
    }
    if !text.is_empty() {
        text += "\n";
    }
    text
}

/// A standard deviation in sizes of the unidentifiable combination: beyond a thousand its digits are rounding.
pub(super) fn how_unseen(std: f64) -> String {
    if std < 1e3 { format!("{std:.1} of its size") } else { "over 1000 times its size".to_owned() }
}
