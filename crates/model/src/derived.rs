//! Channels computed from others, sample by sample: `speed [m/s]=hypot(vx, vy)`.
//!
//! The expressions are those of models, with additional functions that expand to expressions: magnitudes, angles and rotations. A quaternion is (w, x, y, z)
//! and rotates the body's axes into the world's, as PX4 and ROS log it (ROS writes w last).
//!
//! How it can be wrong: a sample missing in any source is missing in the result. So is one that is not finite (a division by 0). A quaternion of another length
//! than 1 gives no rotation.

use crate::equations::error::EquationError;
use crate::equations::system::{Equations, OutputVariable, Symbol};
use deadtime_log::{Channel, Log, LogError};
use deadtime_signal::text::shown;

/// Longest expanded expression.
const LONGEST: usize = 1 << 16;
/// Deepest nesting of functions.
const DEEPEST: usize = 32;

/// Functions that expand to expressions: name, number of arguments, expansion.
const STANDS_FOR: [(&str, usize, &str); 9] = [
    ("hypot", 2, "sqrt($1^2 + $2^2)"),
    ("deg", 1, "($1*57.295779513082320877)"),
    ("rad", 1, "($1*0.017453292519943295769)"),
    ("roll", 4, "atan2(2*($1*$2 + $3*$4), 1 - 2*($2^2 + $3^2))"),
    ("pitch", 4, "asin(max(-1, min(1, 2*($1*$3 - $4*$2))))"),
    ("yaw", 4, "atan2(2*($1*$4 + $2*$3), 1 - 2*($3^2 + $4^2))"),
    ("body_x", 7, "((1 - 2*($3^2 + $4^2))*$5 + 2*($2*$3 + $1*$4)*$6 + 2*($2*$4 - $1*$3)*$7)"),
    ("body_y", 7, "(2*($2*$3 - $1*$4)*$5 + (1 - 2*($2^2 + $4^2))*$6 + 2*($3*$4 + $1*$2)*$7)"),
    ("body_z", 7, "(2*($2*$4 + $1*$3)*$5 + 2*($3*$4 - $1*$2)*$6 + (1 - 2*($2^2 + $3^2))*$7)"),
];

/// A channel that cannot be computed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DerivedError {
    /// No name, or no expression.
    #[error("`{text}`: write a channel as NAME=EXPRESSION or NAME [UNIT]=EXPRESSION, such as speed=hypot(vx,vy)", text = shown(text))]
    Syntax {
        /// The text given.
        text: String,
    },
    /// A name or a parenthesis that does not end.
    #[error("`{text}`: what begins with {open} is never closed", text = shown(text))]
    Open {
        /// The text given.
        text: String,
        /// The sign.
        open: char,
    },
    /// A wrong number of arguments.
    #[error("`{text}`: `{function}` takes {needed} arguments, {got} given", text = shown(text))]
    Arguments {
        /// The text given.
        text: String,
        /// The function.
        function: &'static str,
        /// Arguments required.
        needed: usize,
        /// Arguments given.
        got: usize,
    },
    /// Too deep or too long.
    #[error("`{text}`: the expression is too long; give parts of it names of their own", text = shown(text))]
    TooLong {
        /// The text given.
        text: String,
    },
    /// An invalid expression.
    #[error("`{text}`: {source}", text = shown(text))]
    Expression {
        /// The text given.
        text: String,
        /// The error, with its position.
        source: EquationError,
    },
}

/// A channel as an expression in others.
#[derive(Debug)]
pub struct Derived {
    name: String,
    unit: Option<String>,
    sources: Vec<String>,
    equations: Equations,
}

impl Derived {
    /// From `NAME=EXPRESSION`, `NAME [UNIT]=EXPRESSION`. Channels are referred to by their names; names with other characters than letters, digits, `_`, `.`
    /// and indices in brackets need backticks.
    ///
    /// # Errors
    /// [`DerivedError`].
    pub fn parse(text: &str) -> Result<Self, DerivedError> {
        let syntax = || DerivedError::Syntax { text: text.to_owned() };
        let (header, expression) = text.split_once('=').ok_or_else(syntax)?;
        let (name, unit) = deadtime_log::csv::name_and_unit(header);
        if name.is_empty() || expression.trim().is_empty() {
            return Err(syntax());
        }
        let mut reading = Reading { text, sources: Vec::new() };
        let equation = reading.expanded(expression, 0)?;
        let inputs =
            (0..reading.sources.len()).map(|i| Symbol { name: place(i), unit: None }).collect();
        let output = OutputVariable { name: "result".to_owned(), unit: None, equation };
        let equations = Equations::new(inputs, Vec::new(), Vec::new(), vec![output])
            .map_err(|source| DerivedError::Expression { text: text.to_owned(), source })?;
        Ok(Self {
            name: name.to_owned(),
            unit: unit.map(str::to_owned),
            sources: reading.sources,
            equations,
        })
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its source channels.
    #[must_use]
    pub fn sources(&self) -> &[String] {
        &self.sources
    }

    /// The log with the channel.
    ///
    /// # Errors
    /// [`deadtime_log::LogError`] for a missing source, and for an existing name.
    pub fn add_to(&self, log: Log) -> Result<Log, LogError> {
        let sources =
            self.sources.iter().map(|name| log.output(name)).collect::<Result<Vec<_>, _>>()?;
        let (mut values, mut present) =
            (Vec::with_capacity(log.len()), Vec::with_capacity(log.len()));
        let (mut workspace, mut u, mut y) =
            (self.equations.workspace(), vec![0.0; sources.len()], [0.0]);
        let start = log.time_s().first().copied().unwrap_or(0.0);
        for (k, time) in log.time_s().iter().enumerate() {
            let whole = u
                .iter_mut()
                .zip(&sources)
                .all(|(u, source)| source.get(k).map(|v| *u = v).is_some());
            y[0] = f64::NAN;
            if whole {
                self.equations.outputs(time - start, &[], &u, &[], &mut workspace, &mut y);
            }
            values.push(if y[0].is_finite() { y[0] } else { 0.0 });
            present.push(y[0].is_finite());
        }
        drop(sources);
        log.with_channel(Channel::partial(&*self.name, self.unit.as_deref(), values, present))
    }
}

/// The name of a source in the model's parser.
fn place(at: usize) -> String {
    format!("source{at}")
}

struct Reading<'a> {
    text: &'a str,
    sources: Vec<String>,
}

impl Reading<'_> {
    fn source(&mut self, name: &str) -> String {
        let at = self.sources.iter().position(|s| s == name).unwrap_or_else(|| {
            self.sources.push(name.to_owned());
            self.sources.len() - 1
        });
        place(at)
    }

    /// The expression with every channel under its parser name, and with expanded functions.
    fn expanded(&mut self, expression: &str, depth: usize) -> Result<String, DerivedError> {
        if depth > DEEPEST {
            return Err(DerivedError::TooLong { text: self.text.to_owned() });
        }
        let mut out = String::new();
        let mut rest = expression;
        while let Some(first) = rest.chars().next() {
            let taken = if first == '`' {
                let end = rest[1..]
                    .find('`')
                    .ok_or_else(|| DerivedError::Open { text: self.text.to_owned(), open: '`' })?;
                out.push_str(&self.source(&rest[1..=end]));
                end + 2
            } else if first.is_ascii_digit() {
                let end = number(rest);
                out.push_str(&rest[..end]);
                end
            } else if first.is_alphabetic() || first == '_' {
                let end = name(rest);
                let (word, behind) = (&rest[..end], rest[end..].trim_start());
                if behind.starts_with('(') {
                    let open = rest.len() - behind.len();
                    let close = closing(behind).ok_or_else(|| DerivedError::Open {
                        text: self.text.to_owned(),
                        open: '(',
                    })?;
                    let call = self.call(word, &behind[1..close], depth)?;
                    out.push_str(&call);
                    open + close + 1
                } else {
                    match word {
                        "pi" => out.push_str("3.141592653589793"),
                        "time" => out.push_str("time"),
                        _ => out.push_str(&self.source(word)),
                    }
                    end
                }
            } else {
                out.push(first);
                first.len_utf8()
            };
            if out.len() > LONGEST {
                return Err(DerivedError::TooLong { text: self.text.to_owned() });
            }
            rest = &rest[taken..];
        }
        Ok(out)
    }

    fn call(&mut self, function: &str, inside: &str, depth: usize) -> Result<String, DerivedError> {
        let arguments = arguments(inside)
            .into_iter()
            .map(|a| self.expanded(a, depth + 1))
            .collect::<Result<Vec<_>, _>>()?;
        let Some((function, needed, stands_for)) =
            STANDS_FOR.into_iter().find(|(name, ..)| *name == function)
        else {
            return Ok(format!("{function}({})", arguments.join(",")));
        };
        if arguments.len() != needed {
            return Err(DerivedError::Arguments {
                text: self.text.to_owned(),
                function,
                needed,
                got: arguments.len(),
            });
        }
        let mut parts = stands_for.split('$');
        let mut out = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            let (digit, rest) = part.split_at(1);
            let argument =
                digit.parse::<usize>().ok().and_then(|d| arguments.get(d.wrapping_sub(1)));
            out.push_str(&format!("({}){rest}", argument.map_or("", String::as_str)));
            if out.len() > LONGEST {
                return Err(DerivedError::TooLong { text: self.text.to_owned() });
            }
        }
        Ok(out)
    }
}

/// The end of a number, its exponent included.
fn number(text: &str) -> usize {
    let bytes = text.as_bytes();
    let mut end = 0;
    while bytes.get(end).is_some_and(|b| b.is_ascii_digit() || *b == b'.') {
        end += 1;
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        if bytes.get(end + 1 + sign).is_some_and(u8::is_ascii_digit) {
            end += 1 + sign;
            while bytes.get(end).is_some_and(u8::is_ascii_digit) {
                end += 1;
            }
        }
    }
    end
}

/// The end of a name: letters, digits, `_`, `.` and indices in brackets.
fn name(text: &str) -> usize {
    let mut inside = false;
    for (at, c) in text.char_indices() {
        match c {
            '[' if !inside => inside = true,
            ']' if inside => inside = false,
            c if inside && c.is_ascii_digit() => {}
            c if !inside && (c.is_alphanumeric() || c == '_' || c == '.') => {}
            _ => return at,
        }
    }
    text.len()
}

/// The position of the parenthesis that closes the first one.
fn closing(text: &str) -> Option<usize> {
    let (mut depth, mut quoted) = (0_usize, false);
    for (at, c) in text.char_indices() {
        match c {
            '`' => quoted = !quoted,
            '(' if !quoted => depth += 1,
            ')' if !quoted => {
                depth -= 1;
                if depth == 0 {
                    return Some(at);
                }
            }
            _ => {}
        }
    }
    None
}

/// The parts between commas outside parentheses.
fn arguments(text: &str) -> Vec<&str> {
    let (mut depth, mut quoted, mut from, mut parts) = (0_usize, false, 0, Vec::new());
    for (at, c) in text.char_indices() {
        match c {
            '`' => quoted = !quoted,
            '(' if !quoted => depth += 1,
            ')' if !quoted => depth = depth.saturating_sub(1),
            ',' if !quoted && depth == 0 => {
                parts.push(&text[from..at]);
                from = at + 1;
            }
            _ => {}
        }
    }
    if !text[from..].trim().is_empty() || !parts.is_empty() {
        parts.push(&text[from..]);
    }
    parts
}
