//! The text of a plan, kept so that an error can tell the line.

use std::sync::Arc;

use super::error::{Error, StudyError};
use deadtime_signal::registry::RegistryError;

/// The name and text of a plan's source; empty for a plan without a file. The origin is no part of a plan: all are equal.
#[derive(Debug, Clone, Default)]
pub struct Origin(Option<Arc<(String, String)>>);

impl PartialEq for Origin {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Origin {
    pub(super) fn of(name: &str, text: &str) -> Self {
        Self(Some(Arc::new((name.to_owned(), text.to_owned()))))
    }

    /// File and line of a message.
    fn line(&self, detail: &str) -> Option<String> {
        let (name, text) = &**self.0.as_ref()?;
        Some(format!("{name}, line {}", line_of(text, detail)))
    }

    pub(super) fn study(&self, error: StudyError) -> StudyError {
        match error {
            StudyError::Plan { plan, detail } => {
                StudyError::Plan { plan: self.line(&detail).unwrap_or(plan), detail }
            }
            other => other,
        }
    }

    /// The same error, with file and line where it is about the plan.
    pub(super) fn place(&self, error: Error) -> Error {
        match error {
            Error::Study(error) => self.study(error).into(),
            Error::Registry(source) => match self.line(&source.to_string()) {
                Some(place) => {
                    RegistryError::At { place: format!("plan {place}"), source: Box::new(source) }
                        .into()
                }
                None => source.into(),
            },
            other => other,
        }
    }
}

/// The line, from 1, of a message. It is that of the first quoted key or word, in the named grid; else that of the grid.
fn line_of(text: &str, detail: &str) -> usize {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let headers: Vec<usize> = lines
        .iter()
        .enumerate()
        .filter(|(_, l)| l.starts_with("[[grids]]"))
        .map(|(at, _)| at)
        .collect();
    let grid =
        detail.strip_prefix("grid ").and_then(|rest| rest.split(':').next()?.parse::<usize>().ok());
    let from = grid.and_then(|g| headers.get(g.checked_sub(1)?).copied()).unwrap_or(0);
    let own = from..headers
        .iter()
        .copied()
        .find(|at| *at > from)
        .filter(|_| grid.is_some())
        .unwrap_or(lines.len());
    let quoted = detail.split('`').skip(1).step_by(2);
    // `noises.NAME: …` and `scoring.kept_percent: …` begin with the key.
    let after_grid = grid.and_then(|_| detail.split_once(':')).map_or(detail, |(_, rest)| rest);
    let begins =
        after_grid.split(':').map(str::trim).take_while(|w| !w.is_empty() && !w.contains(' '));
    let last = |w: &str| w.rsplit('.').next().unwrap_or(w).to_owned();
    let words: Vec<String> =
        begins.chain(quoted).map(|w| last(w.trim())).filter(|w| !w.is_empty()).collect();
    let is_key = |line: &str, word: &str| {
        let header = line
            .strip_prefix('[')
            .is_some_and(|h| h.trim_matches(['[', ']']).rsplit('.').next() == Some(word));
        header
            || line
                .trim_start_matches('"')
                .strip_prefix(word)
                .is_some_and(|rest| rest.trim_start_matches(['"', ' ']).starts_with('='))
    };
    // The first word counts most; the grid's own lines come before those that all grids share.
    let find = |fits: &dyn Fn(&str, &str) -> bool| {
        let at = |range: std::ops::Range<usize>, word: &str| {
            range.clone().find(|at| lines.get(*at).is_some_and(|line| fits(line, word)))
        };
        words.iter().find_map(|word| at(own.clone(), word).or_else(|| at(0..lines.len(), word)))
    };
    let plain = |c: char| c.is_alphanumeric() || c == '_';
    let holds = |line: &str, word: &str| {
        let whole = if word.chars().all(plain) {
            line.split(|c| !plain(c)).any(|w| w == word)
        } else {
            line.contains(word)
        };
        whole && !line.starts_with('#')
    };
    find(&is_key).or_else(|| find(&holds)).unwrap_or(from) + 1
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::budget::Budget;
    use crate::plan::Plan;
    use crate::run::Runner;

    const PLAN: &str = r#"format = "deadtime/plan@1"
name = "p"
excitation = ["rbs"]
samples = 200
[noises.n]
ar = [0.5]
[[grids]]
grid = "a"
plant = ["slow2"]
method = ["crosscorr"]
[[grids]]
grid = "b"
plant = ["slow2"]
method = ["crosscorr"]
"#;

    #[test]
    fn every_error_of_a_plan_names_the_file_and_the_line() {
        let told = |from: &str, to: &str| {
            let plan = Plan::parse("p.toml", &PLAN.replacen(from, to, 1), Path::new("."));
            let error = plan
                .map_err(crate::error::Error::from)
                .and_then(|p| Runner::untried(&p, &Budget::default()).map(drop))
                .unwrap_err();
            error.to_string()
        };
        for (from, to, line) in [
            ("name = \"p\"", "name = ", 2),
            ("deadtime/plan@1", "deadtime/plan@2", 1),
            ("samples = 200", "sample = 200", 4),
            ("samples = 200", "samples = 0", 4),
            ("[\"rbs\"]", "[\"rbx\"]", 3),
            ("ar = [0.5]", "ar = [0.5]\ninnovation_std = -1.0", 5),
            ("ar = [0.5]", "at = [0.5]", 6),
            ("grid = \"b\"", "grid = \"a\"", 8),
            ("grid = \"b\"\nplant = [\"slow2\"]", "grid = \"b\"\nplant = [\"slow9\"]", 13),
            (
                "grid = \"b\"\nplant = [\"slow2\"]\nmethod = [\"crosscorr\"]",
                "grid = \"b\"\nplant = [\"slow2\"]\nmethod = [\"x\"]",
                14,
            ),
            ("grid = \"b\"\n", "grid = \"b\"\nbanana = 1\n", 13),
        ] {
            let said = told(from, to);
            assert!(
                said.starts_with("plan p.toml") && said.contains(&format!("line {line}")),
                "{to}: {said}"
            );
            assert_eq!(said.lines().count(), 1, "{said}");
        }
    }
}
