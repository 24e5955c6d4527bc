//! Block bootstrap: blocks of the regressions' rows, drawn with replacement.

use faer::Mat;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::recordings::{Factor, Layout, Recordings, Scales, triangle};

/// Blocks without overlap; each replicate draws as many as there are.
///
/// A row contains an output with its whole past, so block edges cut only the correlation of errors beyond the past.
/// Assumes: errors with a correlation length below a block, a stationary process. Fails when: there are few blocks: intervals are then too narrow.
/// Source: Carlstein (1986), Ann. Stat. 14(3), 1171-1179, doi:10.1214/aos/1176350057; Lahiri (2003), "Resampling Methods for Dependent Data",
/// doi:10.1007/978-1-4757-3803-2.
pub(super) struct Blocks {
    layouts: Vec<Layout>,
    /// By block, a factor for each layout.
    blocks: Vec<Vec<Mat<f64>>>,
    /// By block, its stretch and samples.
    ranges: Vec<(usize, usize, usize)>,
    rows: usize,
    seed: u64,
}

/// Shortest block, rows.
const SHORTEST: usize = 20;
/// Minimum number of blocks where records allow it.
const FEWEST: usize = 20;
/// Streams of random numbers reserved for these draws of a seed.
const STREAM: u64 = 1 << 32;

impl Blocks {
    /// Blocks of twice the longest past, with equal cuts for all pasts.
    pub(super) fn of(recordings: &Recordings, pasts: &[usize], scales: &Scales, seed: u64) -> Self {
        let first = pasts.iter().copied().max().unwrap_or(1);
        let rows = recordings.rows(first);
        let length = (2 * first).max(SHORTEST).min((rows / FEWEST).max(1));
        let by_past: Vec<Vec<Mat<f64>>> =
            pasts.iter().map(|past| recordings.blocks((*past, first), length, scales)).collect();
        let count = by_past.iter().map(Vec::len).min().unwrap_or(0);
        let blocks = (0..count).map(|b| by_past.iter().map(|of| of[b].clone()).collect()).collect();
        let layouts = pasts
            .iter()
            .map(|past| Layout {
                m: recordings.inputs.len(),
                l: recordings.outputs.len(),
                past: *past,
            })
            .collect();
        Self { layouts, blocks, ranges: recordings.ranges(first, length), rows, seed }
    }

    /// The factor for each past of one replicate, and the weight of each sample; empty without blocks.
    pub(super) fn replicate(&self, number: usize) -> (Vec<Factor>, Vec<Vec<f64>>) {
        let count = self.blocks.len();
        if count == 0 {
            return Default::default();
        }
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(STREAM + number as u64);
        let drawn: Vec<usize> = (0..count).map(|_| rng.random_range(0..count)).collect();
        let one = |(which, layout): (usize, &Layout)| {
            let above: Vec<(usize, usize)> = drawn
                .iter()
                .flat_map(|b| (0..self.blocks[*b][which].nrows()).map(move |row| (*b, row)))
                .collect();
            let all = Mat::from_fn(above.len(), layout.columns() + 1, |i, j| {
                self.blocks[above[i].0][which][(above[i].1, j)]
            });
            Factor::joined(*layout, self.rows, [triangle(&all)])
        };
        (self.layouts.iter().enumerate().map(one).collect(), self.weights(&drawn))
    }

    /// By stretch and sample, the root of its block's number of draws; 1 before the first block.
    fn weights(&self, drawn: &[usize]) -> Vec<Vec<f64>> {
        let stretches = self.ranges.iter().map(|(s, ..)| s + 1).max().unwrap_or(0);
        let mut weights = vec![Vec::new(); stretches];
        for (block, (stretch, from, to)) in self.ranges.iter().enumerate() {
            let of: &mut Vec<f64> = &mut weights[*stretch];
            if of.is_empty() {
                of.resize(*from, 1.0);
            }
            let times = drawn.iter().filter(|b| **b == block).count() as f64;
            of.resize(*to, times.sqrt());
        }
        weights
    }
}
