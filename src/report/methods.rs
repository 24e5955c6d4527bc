//! All methods compared: what each needs and cannot see, and how it did in the common study.

use std::fmt::Write;

use super::estimate::run_time;
use super::text::Table;
use deadtime_delay::{Class, Condition, Law, METHODS, ReferenceExperiment};
use deadtime_study::{Common, CommonScore as Score, MethodRow};

/// Errors and times, class by class.
#[must_use]
pub fn errors(rows: &[MethodRow]) -> Table {
    let headings = [
        "method",
        "made for",
        "error",
        "held",
        "none",
        "lag: error",
        "held",
        "none",
        "loop: error",
        "held",
        "none",
        "time",
    ];
    let mut table = Table::new(&headings, &[0, 1]);
    let cells = |score: Option<&Score>| match score {
        None => ["", "", ""].map(str::to_owned),
        Some(s) => {
            let share = |v: Option<f64>| {
                v.map_or_else(|| "–".to_owned(), |v| format!("{:.0} %", 100.0 * v))
            };
            let none = s.trials - s.found;
            [
                s.rms_samples.map_or_else(|| "–".to_owned(), |v| format!("{v:.2}")),
                share(s.coverage95),
                none.to_string(),
            ]
        }
    };
    let reference = |name: &str| {
        METHODS.iter().find(|m| m.entry.name == name).map_or("", |m| made_for(m.reference))
    };
    for class in Class::ALL {
        for row in rows.iter().filter(|r| r.class == *class) {
            let mut line = vec![row.method.to_owned(), reference(row.method).to_owned()];
            line.extend(cells(Some(&row.on_reference)));
            line.extend(cells(row.lag.as_ref()));
            line.extend(cells(row.feedback.as_ref()));
            line.push(run_time(row.time_s));
            table.row(line);
        }
    }
    table
}

fn made_for(reference: ReferenceExperiment) -> &'static str {
    match reference {
        ReferenceExperiment::Plant => "plant",
        ReferenceExperiment::Process { .. } => "its own plant",
        ReferenceExperiment::Copy => "copy",
        ReferenceExperiment::Steps => "steps",
        ReferenceExperiment::Skewed => "skewed copy",
        ReferenceExperiment::States => "states",
        ReferenceExperiment::Events => "events",
    }
}

/// The summary, the needs, the limits and the robustness of each method.
fn needs(class: Class) -> Table {
    let mut table = Table::new(
        &["method", "what it does", "needs", "cannot see", "withstands", "does not promise"],
        &[0, 1, 2, 3, 4, 5],
    );
    for m in METHODS.iter().filter(|m| m.class == class) {
        let list =
            |names: Vec<&str>| if names.is_empty() { "–".to_owned() } else { names.join(", ") };
        table.row(vec![
            format!("`{}`", m.entry.name),
            m.entry.summary.to_owned(),
            m.needs.to_owned(),
            m.blind_to.to_owned(),
            list(m.withstands.iter().map(|c: &Condition| c.words()).collect()),
            list(m.exempt.iter().map(|(law, _)| law_words(*law)).collect()),
        ]);
    }
    table
}

fn law_words(law: Law) -> &'static str {
    match law {
        Law::Shift => "to move with the output",
        Law::Gain => "to ignore gains",
        Law::Sign => "to ignore signs",
        Law::Exact => "whole samples without noise",
        Law::Silence => "silence on noise alone",
        Law::Window => "to know its window",
    }
}

/// The page docs/results/methods.md.
#[must_use]
pub fn page(study: &Common, rows: &[MethodRow]) -> String {
    let mut text = String::from("# The methods\n\n");
    let _ = writeln!(
        text,
        "`deadtime methods --trials {} --samples {} --seed {} --out docs/results/methods.md` writes this page. {} methods; their equations, assumptions, failures and \
         sources stand on [a page each](../methods/index.md), their options in `deadtime list methods`.\n",
        study.trials,
        study.samples,
        study.seed,
        METHODS.len()
    );
    text.push_str("## What each needs, and what it cannot see\n\n");
    for class in Class::ALL.iter().filter(|c| METHODS.iter().any(|m| m.class == **c)) {
        let title = class.title();
        let _ = writeln!(
            text,
            "### {}{}\n\n{}",
            title[..1].to_uppercase(),
            &title[1..],
            needs(*class).markdown()
        );
    }
    let _ = writeln!(
        text,
        "*Withstands* is a claim that the contract tests check: under that complication the 95 % interval still holds the truth.\n\n\
         ## Errors and times\n\n\
         {} records of {} samples of each kind, the true dead time uniform from 2 to 12 samples, fractions included, noise of a hundredth of the signal's power. \
         *Error* is the root mean square error in samples over the records with an answer, *held* the share of them whose 95 % interval holds the truth, *none* the \
         records without an answer. A method that counts samples cannot do better than 0.29 when it rounds and 0.58 when it takes the sample in which the \
         dead time ends.\n\n\
         - *made for*: a **plant** of time constant 8 s sampled every second and moved by a random binary input; a band-limited **copy** of the input; \
         **steps** on 1/((10s + 1)(s + 1)) from rest; a **skewed copy** of pulses that come at random; measured **states** of a vehicle; times of \
         **events** with a jitter.\n\
         - *lag*: the plant above, for every method that looks at one input and one output.\n\
         - *loop*: the same plant under proportional feedback, with noise that the controller feeds back, from the plant's true input.\n\
         - *time*: median of one estimate on one core of the machine that wrote this page.\n\n{}",
        study.trials,
        study.samples,
        errors(rows).markdown()
    );
    text
}
