//! `deadtime demo`.
/// Run the main job on a simulated UAV flight that ships with the program
#[derive(Debug, clap::Args)]
pub(super) struct Demo {}
impl Demo {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        Ok(())
    }
}
