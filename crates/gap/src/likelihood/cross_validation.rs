//! Errors of blocks of time that parameters and starts were not fitted to.
//!
//! How it can be wrong: one Gauss-Newton step stands for a fit without the block, so a cost with kinks is judged by its slope at the fit to all; what a block
//! alone determines (a start at the first, a limit that acts once) is predicted by the prior, in every rival alike.

use nalgebra::{DMatrix, DVector};

use super::gaussian::{Likelihood, Whitened};

/// Blocks that are left out in turn, over all records; and of one record at least.
const BLOCKS: usize = 10;
const FEWEST: usize = 4;
/// Keeps directions that the data do not see from being singular, in units of a column's squared length.
const RIDGE: f64 = 1e-9;

/// One block: its record, its derivatives by all that is free there, its whitened residual.
struct Block {
    at: usize,
    derivatives: DMatrix<f64>,
    residual: DVector<f64>,
}

/// Where the free numbers stand among each other: shared parameters first, then every record's nuisances.
struct Layout {
    shared: usize,
    nuisances: Vec<usize>,
}

impl Layout {
    fn first_of(&self, record: usize) -> usize {
        self.shared + self.nuisances[..record].iter().sum::<usize>()
    }

    fn all(&self) -> usize {
        self.first_of(self.nuisances.len())
    }

    /// The place of a block's column.
    fn place(&self, block: &Block, column: usize) -> usize {
        if column < self.shared { column } else { self.first_of(block.at) + column - self.shared }
    }
}

impl Likelihood<'_> {
    /// Squared whitened errors of blocks of time of the training spans (Stone 1974, doi:10.1111/j.2517-6161.1974.tb00994.x), each predicted by parameters
    /// and nuisances fitted to the other blocks: one Gauss-Newton step from a fit to all. `columns`: derivatives of the whitened residual by the shared
    /// parameters; `precision`: of the prior of each about its present value, and how far from the prior's mean it stands, in units of the parameter.
    pub(crate) fn left_out(
        &self,
        residual: &Whitened,
        columns: &[Whitened],
        prior: &[(f64, f64)],
    ) -> Option<Vec<f64>> {
        let length: Vec<f64> =
            columns.iter().map(|c| unit_of(c.iter().map(DVector::norm_squared).sum())).collect();
        let trained = |at: usize| {
            if self.records[at].train.is_some() { self.nuisances_of(at).ncols() } else { 0 }
        };
        let layout = Layout {
            shared: columns.len(),
            nuisances: (0..self.records.len()).map(trained).collect(),
        };
        let blocks = self.blocks(residual, columns, &length, &layout);
        let (mut information, mut gradient) =
            (DMatrix::zeros(layout.all(), layout.all()), DVector::zeros(layout.all()));
        for (c, (precision, off)) in prior.iter().enumerate() {
            information[(c, c)] += precision / (length[c] * length[c]);
            gradient[c] += precision * off / length[c];
        }
        for c in 0..layout.shared {
            information[(c, c)] += RIDGE;
        }
        for at in (0..self.records.len()).filter(|&at| self.records[at].train.is_some()) {
            let (first, size) = (layout.first_of(at), layout.nuisances[at]);
            let mut own = information.view_mut((first, first), (size, size));
            own += self.precision_of(at);
        }
        for block in &blocks {
            add(&mut information, &mut gradient, block, &layout, 1.0);
        }
        let missed = |block: &Block| {
            let (mut others, mut rest) = (information.clone(), gradient.clone());
            add(&mut others, &mut rest, block, &layout, -1.0);
            let step = others.cholesky()?.solve(&rest);
            let here =
                DVector::from_fn(block.derivatives.ncols(), |c, _| step[layout.place(block, c)]);
            Some((&block.residual - &block.derivatives * here).norm_squared())
        };
        blocks.iter().map(missed).collect()
    }

    fn blocks(
        &self,
        residual: &Whitened,
        columns: &[Whitened],
        length: &[f64],
        layout: &Layout,
    ) -> Vec<Block> {
        let trained = self.records.iter().filter(|r| r.train.is_some()).count().max(1);
        let count = BLOCKS.div_ceil(trained).max(FEWEST);
        let mut blocks = Vec::new();
        for (at, record) in self.records.iter().enumerate() {
            let Some(span) = record.train else { continue };
            let samples = record.time_s.len();
            let edge = |b: usize| span.from_s + (span.to_s - span.from_s) * b as f64 / count as f64;
            let first = |b: usize| {
                if b == count {
                    record.trained_samples()
                } else {
                    record.time_s.partition_point(|t| *t < edge(b))
                }
            };
            for block in 0..count {
                let inside = first(block)..first(block + 1).max(first(block));
                let rows: Vec<usize> = (0..record.measured.len())
                    .flat_map(|i| inside.clone().map(move |k| i * samples + k))
                    .collect();
                let start = self.nuisances_of(at);
                let derivative = |r: usize, c: usize| {
                    if c < layout.shared {
                        columns[c][at][rows[r]] / length[c]
                    } else {
                        start[(rows[r], c - layout.shared)]
                    }
                };
                blocks.push(Block {
                    at,
                    derivatives: DMatrix::from_fn(
                        rows.len(),
                        layout.shared + layout.nuisances[at],
                        derivative,
                    ),
                    residual: DVector::from_iterator(
                        rows.len(),
                        rows.iter().map(|&r| residual[at][r]),
                    ),
                });
            }
        }
        blocks
    }
}

/// The length of a column that is its unit: of one that the data do not see at all (how long a jump takes between two samples), 1.
fn unit_of(squared: f64) -> f64 {
    if squared.is_normal() { squared.sqrt() } else { 1.0 }
}

/// Adds a block's part of the normal equations, or takes it out.
fn add(
    information: &mut DMatrix<f64>,
    gradient: &mut DVector<f64>,
    block: &Block,
    layout: &Layout,
    sign: f64,
) {
    let (g, b) =
        (block.derivatives.tr_mul(&block.derivatives), block.derivatives.tr_mul(&block.residual));
    for c in 0..g.ncols() {
        gradient[layout.place(block, c)] += sign * b[c];
        for d in 0..g.ncols() {
            information[(layout.place(block, c), layout.place(block, d))] += sign * g[(c, d)];
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::likelihood::active_effects::NO_EFFECT;
    use crate::likelihood::servo::beside;

    /// How long a jump takes between two samples is seen by nobody: blocks are predicted as without that number.
    #[test]
    fn a_number_that_the_data_do_not_see_changes_nothing() {
        beside(&[("input_delay", "u", &[0.06])], |likelihood, _| {
            let residual = likelihood.whitened(NO_EFFECT).unwrap();
            let seen: Vec<_> = residual.iter().map(|r| r.map(|v| v + 0.3)).collect();
            let unseen: Vec<_> = residual.iter().map(|r| 0.0 * r).collect();
            let alone =
                likelihood.left_out(&residual, std::slice::from_ref(&seen), &[(0.0, 0.0)]).unwrap();
            let both =
                likelihood.left_out(&residual, &[seen, unseen], &[(0.0, 0.0), (0.0, 0.0)]).unwrap();
            assert!(
                alone.iter().zip(&both).all(|(a, b)| (a / b - 1.0).abs() < 1e-9),
                "{alone:?} {both:?}"
            );
        });
    }
}
