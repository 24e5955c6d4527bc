//! The report card of the check on withheld effects, as text and as Markdown.

use std::fmt::Write as _;

use super::text::Table;
use deadtime_study::blind::{BlindScore, Reliability, SCORES, Score};

/// The scores that tables of parts show.
const COLUMNS: [&str; 9] = [
    "right",
    "top1",
    "top1_class",
    "top3_class",
    "missed",
    "needless_unknown",
    "parameter_error",
    "coverage",
    "of_oracle",
];
/// The names of the parts in a heading.
const PARTS: [(&str, &str); 4] =
    [("effect", "true effect"), ("plant", "plant"), ("strength", "strength"), ("loop", "loop")];

/// For a terminal.
#[must_use]
pub fn text(scores: &BlindScore) -> String {
    let mut text = headline(scores) + "\n";
    for (title, table) in tables(scores) {
        // Writing to a string does not fail.
        let _ = write!(text, "\n{title}\n{table}");
    }
    text
}

/// The same as Markdown.
#[must_use]
pub fn markdown(scores: &BlindScore) -> String {
    let mut text = format!("# Withheld effects\n\n{}\n", headline(scores));
    for (title, table) in tables(scores) {
        let _ = write!(
            text,
            "\n## {}{}\n\n{}",
            title[..1].to_uppercase(),
            &title[1..],
            table.markdown()
        );
    }
    text
}

pub(super) fn headline(scores: &BlindScore) -> String {
    let groups: Vec<String> =
        scores.groups.iter().filter(|(_, n)| **n > 0).map(|(g, n)| format!("{n} {g}")).collect();
    format!("{} cases ({}); every label matches its commitment", scores.cases, groups.join(", "))
}

pub(super) fn tables(scores: &BlindScore) -> Vec<(String, Table)> {
    let mut tables = vec![("scores over all cases".to_owned(), overall(scores))];
    for (key, title) in PARTS {
        let parts = scores.by.iter().filter(|b| b.key == key);
        let mut table = Table::new(&[&[title, "cases"][..], &COLUMNS[..]].concat(), &[0]);
        let mut some = false;
        for part in parts {
            let value =
                |name: &&str| part.scores.iter().find(|s| s.name == *name).and_then(|s| s.value);
            let mut row = vec![part.value.clone(), part.cases.to_string()];
            row.extend(COLUMNS.iter().map(|c| number(value(c))));
            table.row(row);
            some = true;
        }
        if some {
            tables.push((format!("by {title}"), table));
        }
    }
    tables.push(("truth and verdict".to_owned(), confusion(scores)));
    let what = "how often a verdict of a given probability is exactly right";
    tables.push((what.to_owned(), reliability(&scores.reliability, ["verdicts", "exactly right"])));
    if scores.contributions.iter().any(|bin| bin.cases > 0) {
        let what =
            "how often an effect that is reported with a given probability acts, up to its aliases";
        tables.push((what.to_owned(), reliability(&scores.contributions, ["effects", "act"])));
    }
    tables
}

fn overall(scores: &BlindScore) -> Table {
    let mut table = Table::new(&["score", "value", "95 % interval", "of", "what it says"], &[0, 4]);
    for (definition, score) in SCORES.iter().zip(&scores.scores) {
        table.row(vec![
            score.name.into(),
            number(score.value),
            interval(score),
            score.count.to_string(),
            definition.summary.into(),
        ]);
    }
    table
}

fn confusion(scores: &BlindScore) -> Table {
    let mut table = Table::new(&["truth", "cases", "verdicts"], &[0, 2]);
    let mut rows: Vec<(&str, usize, Vec<String>)> = Vec::new();
    for cell in &scores.confusion {
        if rows.last().is_none_or(|r| r.0 != cell.truth) {
            rows.push((&cell.truth, 0, Vec::new()));
        }
        if let Some((_, cases, verdicts)) = rows.last_mut() {
            *cases += cell.cases;
            verdicts.push(format!("{} {}", cell.verdict, cell.cases));
        }
    }
    for (truth, cases, verdicts) in rows {
        table.row(vec![truth.to_owned(), cases.to_string(), verdicts.join(", ")]);
    }
    table
}

fn reliability(bins: &[Reliability], [what, so]: [&str; 2]) -> Table {
    let mut table =
        Table::new(&["probability", what, "mean probability", so, "95 % interval"], &[0]);
    for bin in bins {
        table.row(vec![
            format!("{:.1} to {:.1}", bin.from, bin.to),
            bin.cases.to_string(),
            number(bin.probability),
            number(bin.exact),
            ends(bin.ci95),
        ]);
    }
    table
}

fn interval(score: &Score) -> String {
    ends(score.ci95)
}

pub(super) fn ends(ci95: Option<[f64; 2]>) -> String {
    ci95.map_or_else(
        || "–".to_owned(),
        |[low, high]| format!("{} … {}", number(Some(low)), number(Some(high))),
    )
}

/// Three decimals; large numbers with fewer, small ones in powers of ten.
pub(super) fn number(value: Option<f64>) -> String {
    match value {
        None => "–".to_owned(),
        Some(v) if v != 0.0 && v.abs() < 5e-4 => format!("{v:.1e}"),
        Some(v) if v.abs() >= 1e6 => format!("{v:.1e}"),
        Some(v) if v.abs() >= 100.0 => format!("{v:.0}"),
        Some(v) => format!("{v:.3}"),
    }
}
