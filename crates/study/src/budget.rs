//! How large a study may be, estimated before anything of it is made.

use std::cmp::Ordering;

use super::error::StudyError;
use super::keys::Loop;
use super::plan::{Grid, Plan, spelt};
use deadtime_signal::parallel;
use deadtime_signal::remedy::Remedy;

/// Bytes in a gigabyte.
const GB: f64 = 1e9;
/// Bytes of a setting, and of a cell with its sums and its line of study.json, while a study runs. Measured on 10 000 and 40 000 settings and on 50 000 cells
/// (1.2 kB and 3.3 kB), rounded up.
const SETTING: f64 = 1500.0;
const CELL: f64 = 3500.0;
/// Copies of a record's channels that a method holds, and channels of a record whose plant has not been read. Rough values, meant for records that no machine
/// holds.
const COPIES: f64 = 8.0;
const CHANNELS: f64 = 3.0;
/// Bytes of an estimate on the disk: its lines in a part and in estimates.csv (147 measured there), rounded up.
const ESTIMATE: f64 = 400.0;

/// Limits of a study, each lifted by the option of its name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// Memory, 10⁹ bytes; 4 by default.
    pub memory_gb: f64,
    /// Room on the disk, 10⁹ bytes; 50 by default.
    pub disk_gb: f64,
}

impl Default for Budget {
    fn default() -> Self {
        Self { memory_gb: 4.0, disk_gb: 50.0 }
    }
}

/// The estimated need of a study.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Needs {
    /// Combinations of the plan's lists that make records of their own.
    pub settings: f64,
    /// Numbers of a table: settings times methods.
    pub cells: f64,
    /// Estimates.
    pub estimates: f64,
    /// 10⁹ bytes of memory.
    pub memory_gb: f64,
    /// 10⁹ bytes on the disk.
    pub disk_gb: f64,
}

impl Needs {
    /// From the lengths of the plan's lists; a plant counts as one input and one output, so that the cells of larger ones are more.
    #[must_use]
    pub fn of(plan: &Plan) -> Self {
        let (mut settings, mut cells, mut estimates, mut largest) = (0.0, 0.0, 0.0, 0.0_f64);
        for grid in &plan.grids {
            let of_grid = combinations(grid);
            let methods = grid.method.iter().map(|m| spelt(m)).sum::<usize>() as f64
                * grid.place.len() as f64;
            settings += of_grid;
            cells += of_grid * methods;
            estimates += of_grid * methods * grid.trials as f64;
            largest = largest.max(grid.samples.iter().copied().max().unwrap_or(0) as f64);
        }
        let threads = parallel::threads() as f64;
        let memory = settings * SETTING
            + cells * CELL
            + threads * largest * CHANNELS * COPIES * size_of::<f64>() as f64;
        Self {
            settings,
            cells,
            estimates,
            memory_gb: memory / GB,
            disk_gb: estimates * ESTIMATE / GB,
        }
    }
}

/// The product of a grid's lists; an open loop has no controller to choose.
fn combinations(grid: &Grid) -> f64 {
    let controllers = |l: &Loop| if *l == Loop::Closed { grid.controller.len() } else { 1 };
    let loops: usize = grid.loops.iter().map(controllers).sum();
    let lists = [
        grid.plant.len(),
        grid.c2d.len(),
        grid.excitation.len(),
        grid.snr.len(),
        grid.noise.len(),
        loops,
        grid.delay_s.len(),
        grid.samples.len(),
        grid.sample_time_s.len(),
        grid.max_delay.len(),
        grid.logging.len(),
    ];
    lists.into_iter().map(|n| n as f64).product()
}

impl Budget {
    /// Refuses a plan that needs more.
    ///
    /// # Errors
    /// [`StudyError::Budget`] with the estimate and the option that lifts the limit.
    pub fn check(&self, plan: &Plan) -> Result<(), StudyError> {
        let Needs { settings, cells, estimates, memory_gb, disk_gb } = Needs::of(plan);
        let refused = |what, needed_gb: f64, limit_gb: f64, option| StudyError::Budget {
            plan: plan.name.clone(),
            settings,
            cells,
            estimates,
            what,
            needed_gb,
            limit_gb,
            option,
        };
        // A limit that is no number allows nothing.
        let within = |needed_gb: f64, limit_gb: f64| {
            matches!(needed_gb.partial_cmp(&limit_gb), Some(Ordering::Less | Ordering::Equal))
        };
        if !within(memory_gb, self.memory_gb) {
            return Err(refused("memory", memory_gb, self.memory_gb, Remedy::MaxMemory));
        }
        if !within(disk_gb, self.disk_gb) {
            return Err(refused("room on the disk", disk_gb, self.disk_gb, Remedy::MaxDisk));
        }
        Ok(())
    }
}
