//! Answers as characters on an axis that all rows of a table share.

/// A stretch of numbers that so many characters show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::report) struct Axis {
    from: f64,
    to: f64,
    cells: usize,
}

/// Half-widths of the answer's interval that the axis reaches to either side at most: one answer far off does not set it.
const REACH: f64 = 8.0;

impl Axis {
    /// An axis around an answer and its interval that holds the others' intervals where they are not far off; `None` without a finite stretch.
    pub(in crate::report) fn around(
        answer: f64,
        interval: [f64; 2],
        others: impl Iterator<Item = [f64; 2]>,
        cells: usize,
    ) -> Option<Self> {
        let half = (interval[1] - answer).max(answer - interval[0]);
        let (lowest, highest) = (answer - REACH * half, answer + REACH * half);
        let [from, to] = others
            .fold(interval, |[from, to], [a, b]| [from.min(a.max(lowest)), to.max(b.min(highest))]);
        (from.is_finite() && to.is_finite() && to > from && cells > 2).then_some(Self {
            from,
            to,
            cells,
        })
    }

    /// An axis over all of these intervals.
    pub(in crate::report) fn over(
        intervals: impl Iterator<Item = [f64; 2]>,
        cells: usize,
    ) -> Option<Self> {
        let [from, to] = intervals
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[from, to], [a, b]| {
                [from.min(a), to.max(b)]
            });
        (from.is_finite() && to.is_finite() && to > from && cells > 2).then_some(Self {
            from,
            to,
            cells,
        })
    }

    /// Its ends.
    pub(in crate::report) fn ends(self) -> [f64; 2] {
        [self.from, self.to]
    }

    /// Where a number lies, 0 to 1 on the axis.
    pub(in crate::report) fn share(self, value: f64) -> f64 {
        (value - self.from) / (self.to - self.from)
    }

    /// The cell of a number; beyond the axis, none.
    fn at(self, value: f64) -> Option<usize> {
        let share = self.share(value);
        (-1e-9..=1.0 + 1e-9)
            .contains(&share)
            .then(|| ((share.clamp(0.0, 1.0) * self.cells as f64) as usize).min(self.cells - 1))
    }

    /// An answer `●` on its interval `━`, before the interval `·` of the verdict; an answer beyond the axis is an arrow at its end.
    pub(super) fn bar(
        self,
        answer: f64,
        interval: Option<[f64; 2]>,
        verdict: Option<[f64; 2]>,
    ) -> String {
        let mut line = vec![' '; self.cells];
        for (ends, mark) in [(verdict, '·'), (interval, '━')] {
            let Some([from, to]) = ends.filter(|[from, to]| *from <= self.to && *to >= self.from)
            else {
                continue;
            };
            let (first, last) = (
                self.at(from.max(self.from)).unwrap_or(0),
                self.at(to.min(self.to)).unwrap_or(self.cells - 1),
            );
            line[first..=last].iter_mut().for_each(|c| *c = mark);
        }
        match self.at(answer) {
            Some(at) => line[at] = '●',
            None if answer < self.from => line[0] = '‹',
            None => line[self.cells - 1] = '›',
        }
        line.into_iter().collect()
    }
}

/// A share, 0 to 1, as a bar of at most so many cells, to an eighth of a cell.
pub(super) fn share(share: f64, cells: usize) -> String {
    const PARTS: [&str; 8] = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉"];
    if !share.is_finite() {
        return String::new();
    }
    let eighths = (share.clamp(0.0, 1.0) * 8.0 * cells as f64).round() as usize;
    "█".repeat(eighths / 8) + PARTS[eighths % 8]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_stands_where_it_is_on_the_axis() {
        let axis = Axis::around(0.5, [0.4, 0.6], [[0.0, 1.0]].into_iter(), 10).unwrap();
        assert_eq!(axis.ends(), [0.0, 1.0]);
        assert_eq!(axis.bar(0.5, Some([0.4, 0.6]), None), "    ━●━   ");
        assert_eq!(axis.bar(0.15, Some([0.1, 0.25]), Some([0.4, 0.6])), " ●━ ···   ");
        assert_eq!(axis.bar(7.0, Some([6.0, 8.0]), Some([0.4, 0.6])), "    ···  ›");
        assert_eq!(axis.bar(-7.0, None, None), "‹         ");
        assert_eq!(axis.bar(1.0, None, None), "         ●");
    }

    #[test]
    fn one_answer_far_off_does_not_set_the_axis() {
        let axis =
            Axis::around(0.5, [0.4, 0.6], [[0.3, 0.5], [400.0, 500.0]].into_iter(), 10).unwrap();
        assert!(axis.ends()[1] < 1.5, "{axis:?}");
        assert_eq!(Axis::around(f64::NAN, [0.0, f64::NAN], std::iter::empty(), 10), None);
        assert_eq!(Axis::around(1.0, [1.0, 1.0], std::iter::empty(), 10), None);
    }

    #[test]
    fn shares_fill_cells_by_eighths() {
        assert_eq!(
            [share(0.0, 4), share(0.5, 4), share(0.28, 4), share(2.0, 4), share(f64::NAN, 4)],
            ["", "██", "█▏", "████", ""]
        );
    }
}
