//! The output of a command: all or none, with colour or without; and its JSON.

use std::io::{IsTerminal, Write, stderr, stdout};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::report::styled::Styled;
use deadtime_signal::file::write_atomic;
use deadtime_signal::text::printed;

/// When to colour what is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub(super) enum Color {
    /// On a terminal, unless the environment sets NO_COLOR
    #[default]
    Auto,
    /// Always, also into a file
    Always,
    /// Never
    Never,
}

impl Color {
    fn on(self, aside: bool) -> bool {
        let set = |name: &str| std::env::var_os(name).is_some_and(|v| !v.is_empty());
        match self {
            Self::Always => true,
            Self::Never => false,
            // https://no-color.org; a dumb terminal shows the codes instead of obeying them.
            Self::Auto => {
                !set("NO_COLOR")
                    && std::env::var_os("TERM").is_none_or(|t| t != "dumb")
                    && if aside { stderr().is_terminal() } else { stdout().is_terminal() }
            }
        }
    }
}

/// `println!` of a command's output: see [`Out::line`].
macro_rules! say {
    ($to:expr, $($text:tt)*) => {
        $to.line(&format!($($text)*))?
    };
}

/// Where a command's words go.
#[derive(Debug)]
pub(super) struct Out<'a> {
    json: Option<&'a Path>,
    quiet: bool,
    colour: bool,
    /// Standard output is one of the files that are written: words go to standard error.
    aside: bool,
}

impl<'a> Out<'a> {
    pub(super) fn new(json: Option<&'a Path>, quiet: bool, color: Color, aside: bool) -> Self {
        Self { json, quiet, colour: color.on(aside), aside }
    }

    fn words(&self, text: &str) -> anyhow::Result<()> {
        if self.quiet {
            Ok(())
        } else if self.aside {
            stderr().lock().write_all(text.as_bytes()).context("standard error")
        } else {
            stdout().lock().write_all(text.as_bytes()).context("standard output")
        }
    }

    /// A listing: text that is printed also in quiet mode.
    pub(super) fn listing(&self, text: &str) -> anyhow::Result<()> {
        Self { quiet: false, ..*self }.words(text)
    }

    /// The output of a command without a file, on standard output.
    ///
    /// # Errors
    /// Where another output is there already.
    pub(super) fn document(&self, text: &[u8]) -> anyhow::Result<()> {
        if self.aside {
            bail!("only one output can be standard output: give --out FILE");
        }
        stdout().lock().write_all(text).context("standard output")
    }

    /// A line on standard output, unless in quiet mode; a closed pipe is an error, control characters are shown instead of sent.
    pub(super) fn line(&self, text: &str) -> anyhow::Result<()> {
        self.words(&(printed(text) + "\n"))
    }

    /// The same of a text that has colours.
    pub(super) fn styled(&self, text: &Styled) -> anyhow::Result<()> {
        self.words(&if self.colour { text.coloured() } else { text.plain() })
    }

    /// Somebody waits for words on standard error while a command works.
    pub(super) fn tells_progress(&self) -> bool {
        !self.quiet
    }

    /// The file that JSON is wanted in.
    pub(super) fn json_file(&self) -> Option<&Path> {
        self.json
    }

    pub(super) fn wants_json(&self) -> bool {
        self.json.is_some()
    }

    /// Writes `what` as JSON to the requested file, if any.
    pub(super) fn json(&self, what: &impl serde::Serialize) -> anyhow::Result<()> {
        self.json.map_or(Ok(()), |path| write_json(path, what))
    }
}

/// Writes a text as the requested file, if any.
pub(super) fn write(path: Option<&PathBuf>, text: impl FnOnce() -> String) -> anyhow::Result<()> {
    let Some(path) = path else { return Ok(()) };
    let text = text();
    Ok(write_atomic(path, |out| out.write_all(text.as_bytes()))?)
}

/// Writes `what` as JSON.
pub(super) fn write_json(path: &Path, what: &impl serde::Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(what).with_context(|| path.display().to_string())?;
    write_atomic(path, |out| writeln!(out, "{text}"))?;
    Ok(())
}
