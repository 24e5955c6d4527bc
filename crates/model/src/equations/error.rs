//! What can be wrong with an equation, and a message that points into it.

use std::fmt;

/// Equations that cannot be compiled.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EquationError {
    /// An expression that cannot be understood.
    #[error("{equation}, column {column}: {fault}\n{}", caret(text, *column, *length))]
    Expression {
        /// Which equation, as `derivatives.speed`.
        equation: String,
        /// Its text.
        text: String,
        /// Where the fault begins, in characters from 1.
        column: usize,
        /// How many characters it covers.
        length: usize,
        /// What is wrong and what to do.
        fault: Box<Fault>,
    },
    /// A name that an expression could not use.
    #[error(
        "the {what} `{name}` cannot stand in an expression: begin with a letter or `_` and go on with letters, digits and `_`"
    )]
    Name {
        /// Input, state or parameter.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// More of something than a model may have.
    #[error(
        "the model has {got} {what}, at most {limit} are allowed; split the model, or write repeated parts as one"
    )]
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many there are.
        got: usize,
        /// How many may be.
        limit: usize,
    },
    /// One name for two things.
    #[error(
        "`{name}` is {first} and {second}: every name in the equations means one thing, so rename one of them"
    )]
    Clash {
        /// The name.
        name: String,
        /// What it is first.
        first: &'static str,
        /// What it is as well.
        second: &'static str,
    },
    /// A number that must be finite or not negative is neither.
    #[error("{what} is {value}: {rule}")]
    Number {
        /// Which number.
        what: String,
        /// The number.
        value: f64,
        /// What it must be.
        rule: &'static str,
    },
}

/// What is wrong at one place of an expression.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Fault {
    /// Nothing there.
    Empty,
    /// A character that no expression has.
    Character {
        /// The character.
        found: char,
    },
    /// Digits that are no number.
    Number {
        /// What is written.
        found: String,
    },
    /// A name that is neither input, state, parameter nor `time`.
    UnknownName {
        /// The name.
        name: String,
        /// The known name that is spelled most like it.
        closest: Option<String>,
        /// All known names.
        known: Vec<String>,
    },
    /// A call of something that is no function.
    UnknownFunction {
        /// The name.
        name: String,
        /// The function that is spelled most like it.
        closest: Option<String>,
    },
    /// A function's name without parentheses.
    FunctionAsName {
        /// The function.
        name: &'static str,
    },
    /// Too few or too many arguments.
    Arguments {
        /// The function.
        function: &'static str,
        /// How many it takes.
        needed: usize,
        /// How many are given.
        got: usize,
    },
    /// An operator, comma, closing parenthesis or the end where a value belongs.
    ValueExpected {
        /// What stands there; `None`: the end.
        found: Option<String>,
    },
    /// A value where an operator or the end belongs.
    OperatorExpected {
        /// What stands there.
        found: String,
    },
    /// A parenthesis that nothing closes.
    Unclosed,
    /// A closing parenthesis without an opening one.
    Unopened,
    /// A comma that separates no arguments.
    Comma,
    /// Too many parentheses, signs or powers inside each other.
    TooDeep {
        /// How many are allowed.
        limit: usize,
    },
    /// Too many numbers, names and operators.
    TooLong {
        /// How many are allowed.
        limit: usize,
    },
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => {
                write!(f, "the expression is empty; write a number such as 0 if that is meant")
            }
            Self::Character { found: '=' } => {
                write!(f, "an expression has no `=`; write the right-hand side alone")
            }
            Self::Character { found } => write!(
                f,
                "`{found}` has no meaning here; expressions know + - * / ^ ( ) , numbers and names"
            ),
            Self::Number { found } => write!(f, "`{found}` is no number; write it as 12.5 or 1e-3"),
            Self::UnknownName { name, closest, known } => {
                write!(f, "`{name}` is unknown; ")?;
                if let Some(closest) = closest {
                    write!(f, "did you mean `{closest}`? ")?;
                }
                write!(f, "known names: {}", known.join(", "))
            }
            Self::UnknownFunction { name, closest } => {
                write!(f, "there is no function `{name}`; ")?;
                if let Some(closest) = closest {
                    write!(f, "did you mean `{closest}`? ")?;
                }
                write!(
                    f,
                    "functions: {} (a product needs its `*`)",
                    super::function::names().collect::<Vec<_>>().join(", ")
                )
            }
            Self::FunctionAsName { name } => {
                write!(f, "`{name}` is a function; give its argument in parentheses")
            }
            Self::Arguments { function, needed, got } => {
                let s = if *needed == 1 { "" } else { "s" };
                write!(f, "`{function}` takes {needed} argument{s}, {got} given")
            }
            Self::ValueExpected { found: None } => {
                write!(f, "the expression ends where a number, a name or `(` belongs")
            }
            Self::ValueExpected { found: Some(found) } if found == "**" => {
                write!(f, "a power is written `^`, not `**`")
            }
            Self::ValueExpected { found: Some(found) } => {
                write!(f, "`{found}` stands where a number, a name or `(` belongs")
            }
            Self::OperatorExpected { found } => {
                write!(
                    f,
                    "`{found}` follows a value without an operator; put + - * / or ^ between them, or take it out"
                )
            }
            Self::Unclosed => write!(f, "this parenthesis is never closed; add a `)`"),
            Self::Unopened => {
                write!(f, "this parenthesis closes nothing; take it out or add a `(`")
            }
            Self::Comma => write!(
                f,
                "a comma separates the arguments of a function; a decimal number is written with a point"
            ),
            Self::TooDeep { limit } => write!(
                f,
                "more than {limit} parentheses, signs or powers inside each other; split the expression"
            ),
            Self::TooLong { limit } => {
                write!(f, "more than {limit} numbers, names and operators; split the expression")
            }
        }
    }
}

/// Characters shown before and after a fault in a long expression.
const AROUND: usize = 60;

/// The expression's text with a line of carets under the fault.
fn caret(text: &str, column: usize, length: usize) -> String {
    let start = column.saturating_sub(1);
    let from = start.saturating_sub(AROUND);
    let shown: String = text
        .chars()
        .skip(from)
        .take(2 * AROUND)
        .map(|c| if c.is_whitespace() || c.is_control() { ' ' } else { c })
        .collect();
    let width = length.clamp(1, AROUND);
    format!("  {shown}\n  {}{}", " ".repeat(start - from), "^".repeat(width))
}

/// The candidate that is spelled most like `name`, if any is close.
pub(super) fn closest<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Option<String> {
    let near = candidates
        .map(|c| (edits(&name.to_lowercase(), &c.to_lowercase()), c))
        .min_by_key(|(distance, _)| *distance);
    near.filter(|(distance, c)| *distance <= 1 + c.chars().count().min(name.chars().count()) / 3)
        .map(|(_, c)| c.to_owned())
}

/// Letters to insert, remove or exchange, a swap of neighbours counting as one.
fn edits(a: &str, b: &str) -> usize {
    // Names this long are not mistyped ones.
    let (a, b): (Vec<char>, Vec<char>) =
        (a.chars().take(64).collect(), b.chars().take(64).collect());
    let mut rows: Vec<Vec<usize>> = vec![(0..=b.len()).collect()];
    for i in 1..=a.len() {
        let mut row = vec![i];
        for j in 1..=b.len() {
            let changed = usize::from(a[i - 1] != b[j - 1]);
            let mut least =
                (rows[i - 1][j] + 1).min(row[j - 1] + 1).min(rows[i - 1][j - 1] + changed);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                least = least.min(rows[i - 2][j - 2] + 1);
            }
            row.push(least);
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}
