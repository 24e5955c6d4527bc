//! `deadtime completions` and `deadtime man`: shell completions and man pages, from the definition of the command line.

use std::path::PathBuf;

use anyhow::Context;
use clap_complete::Shell;

use super::show::Out;
use deadtime_signal::file::write_atomic;

/// Print the completions of a shell
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime completions bash > ~/.local/share/bash-completion/completions/deadtime
  deadtime completions zsh > ~/.zfunc/_deadtime
  deadtime completions fish > ~/.config/fish/completions/deadtime.fish")]
pub(super) struct Completions {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

impl Completions {
    pub(super) fn run(&self, to: &Out<'_>, mut command: clap::Command) -> anyhow::Result<()> {
        let mut text = Vec::new();
        clap_complete::generate(self.shell, &mut command, "deadtime", &mut text);
        to.document(&text)
    }
}

/// Write a man page for the program and for each of its commands
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime man ~/.local/share/man/man1
  man deadtime-gap")]
pub(super) struct Man {
    /// Folder to write deadtime.1, deadtime-estimate.1, … to
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl Man {
    pub(super) fn run(&self, to: &Out<'_>, command: clap::Command) -> anyhow::Result<()> {
        let mut command = command.disable_help_subcommand(true);
        command.build();
        let mut pages = Vec::new();
        collect(&command, "deadtime", &mut pages)?;
        for (name, page) in &pages {
            write_atomic(&self.folder.join(name), |out| out.write_all(page))?;
        }
        say!(to, "{} man pages written to {}", pages.len(), self.folder.display());
        Ok(())
    }
}

/// The page of a command and those of its subcommands; each is named with its parents' names before its own.
fn collect(
    command: &clap::Command,
    name: &str,
    pages: &mut Vec<(String, Vec<u8>)>,
) -> anyhow::Result<()> {
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone().display_name(name))
        .render(&mut page)
        .context("man page")?;
    pages.push((format!("{name}.1"), page));
    command
        .get_subcommands()
        .filter(|c| c.get_name() != "help")
        .try_for_each(|c| collect(c, &format!("{name}-{}", c.get_name()), pages))
}
