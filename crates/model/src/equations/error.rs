//! Errors in an equation, with messages that point to the position.

/// Equations that cannot be compiled.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EquationError {
    /// An invalid expression.
    #[error("{equation}, column {column}: {fault}\n{}", caret(text, *column, *length))]
    Expression {
        /// The equation, as `derivatives.speed`.
        equation: String,
        /// Its text.
        text: String,
        /// The position of the fault, in characters from 1.
        column: usize,
        /// The number of characters that it covers.
        length: usize,
        /// The fault and its remedy.
        fault: Box<Fault>,
    },
    /// A name that is not allowed in an expression.
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
        /// The kind.
        what: &'static str,
        /// The number present.
        got: usize,
        /// The number allowed.
        limit: usize,
    },
    /// One name with two meanings.
    #[error(
        "`{name}` is {first} and {second}: every name in the equations means one thing, so rename one of them"
    )]
    Clash {
        /// The name.
        name: String,
        /// Its first meaning.
        first: &'static str,
        /// Its second meaning.
        second: &'static str,
    },
    /// A value that must be finite or not negative is neither.
    #[error("{what} is {value}: {rule}")]
    Number {
        /// Its description.
        what: String,
        /// The value.
        value: f64,
        /// The rule.
        rule: &'static str,
    },
}

/// The fault at one position of an expression.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// An empty expression.
    #[error("the expression is empty; write a number such as 0 if that is meant")]
    Empty,
    /// A character that is not allowed in expressions.
    #[error("{}", meaningless(*found))]
    Character {
        /// The character.
        found: char,
    },
    /// Digits that form no number.
    #[error("`{found}` is no number; write it as 12.5 or 1e-3")]
    Number {
        /// The text.
        found: String,
    },
    /// A name that is neither input, state, parameter nor `time`.
    #[error("`{name}` is unknown; {}known names: {}", meant(closest.as_deref()), known.join(", "))]
    UnknownName {
        /// The name.
        name: String,
        /// The known name with the closest spelling.
        closest: Option<String>,
        /// All known names.
        known: Vec<String>,
    },
    /// A call of an unknown function.
    #[error(
        "there is no function `{name}`; {}functions: {} (a product needs its `*`)",
        meant(closest.as_deref()), super::function::names().collect::<Vec<_>>().join(", ")
    )]
    UnknownFunction {
        /// The name.
        name: String,
        /// The function with the closest spelling.
        closest: Option<String>,
    },
    /// A function's name without parentheses.
    #[error("`{name}` is a function; give its argument in parentheses")]
    FunctionAsName {
        /// The function.
        name: &'static str,
    },
    /// Too few or too many arguments.
    #[error("`{function}` takes {needed} argument{}, {got} given", if *needed == 1 { "" } else { "s" })]
    Arguments {
        /// The function.
        function: &'static str,
        /// The number required.
        needed: usize,
        /// The number given.
        got: usize,
    },
    /// An operator, comma, closing parenthesis or the end instead of a value.
    #[error("{}", misplaced(found.as_deref()))]
    ValueExpected {
        /// The text; `None`: the end.
        found: Option<String>,
    },
    /// A value instead of an operator or the end.
    #[error(
        "`{found}` follows a value without an operator; put + - * / or ^ between them, or take it out"
    )]
    OperatorExpected {
        /// The text.
        found: String,
    },
    /// A parenthesis that is not closed.
    #[error("this parenthesis is never closed; add a `)`")]
    Unclosed,
    /// A closing parenthesis without an opening one.
    #[error("this parenthesis closes nothing; take it out or add a `(`")]
    Unopened,
    /// A comma that separates no arguments.
    #[error(
        "a comma separates the arguments of a function; a decimal number is written with a point"
    )]
    Comma,
    /// Too many nested parentheses, signs or powers.
    #[error(
        "more than {limit} parentheses, signs or powers inside each other; split the expression"
    )]
    TooDeep {
        /// The number allowed.
        limit: usize,
    },
    /// Too many numbers, names and operators.
    #[error("more than {limit} numbers, names and operators; split the expression")]
    TooLong {
        /// The number allowed.
        limit: usize,
    },
}

fn meaningless(found: char) -> String {
    match found {
        '=' => "an expression has no `=`; write the right-hand side alone".to_owned(),
        _ => format!(
            "`{found}` has no meaning here; expressions know + - * / ^ ( ) , numbers and names"
        ),
    }
}

fn meant(closest: Option<&str>) -> String {
    closest.map_or_else(String::new, |closest| format!("did you mean `{closest}`? "))
}

fn misplaced(found: Option<&str>) -> String {
    match found {
        None => "the expression ends where a number, a name or `(` belongs".to_owned(),
        Some("**") => "a power is written `^`, not `**`".to_owned(),
        Some(found) => format!("`{found}` stands where a number, a name or `(` belongs"),
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

/// The candidate with the closest spelling to `name`, if any is close.
pub(super) fn closest<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Option<String> {
    let near = candidates
        .map(|c| (edits(&name.to_lowercase(), &c.to_lowercase()), c))
        .min_by_key(|(distance, _)| *distance);
    near.filter(|(distance, c)| *distance <= 1 + c.chars().count().min(name.chars().count()) / 3)
        .map(|(_, c)| c.to_owned())
}

/// Letters to insert, remove or replace; a swap of neighbours counts as one.
fn edits(a: &str, b: &str) -> usize {
    // Names of this length are not mistyped.
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
