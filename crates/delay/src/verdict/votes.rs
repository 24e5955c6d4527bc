//! The vote of each class of methods, and the estimates around the delay with most votes.

use super::answer::FoundDelay;
use crate::method::Basis;

/// The used estimates, split by whether their intervals hold the delay with most votes.
pub(super) struct Group<'a, 'b> {
    pub(super) lead: &'b FoundDelay<'a>,
    pub(super) agree: Vec<(&'b FoundDelay<'a>, f64)>,
    pub(super) differ: Vec<(&'b FoundDelay<'a>, f64)>,
}

impl<'a, 'b> Group<'a, 'b> {
    /// `counted` has at least one estimate.
    pub(super) fn of(counted: &[&'b FoundDelay<'a>]) -> Self {
        let vote_weights = vote_weights(counted);
        let support = |at: &FoundDelay<'_>| -> f64 {
            counted
                .iter()
                .zip(&vote_weights)
                .filter(|(f, _)| f.holds(at.delay_s))
                .map(|(_, v)| v)
                .sum()
        };
        // Ties go to the most trusted method: the order is that of the list.
        let mut lead = counted[0];
        for f in &counted[1..] {
            if support(f) > support(lead) + 1e-9 {
                lead = f;
            }
        }
        let of_all = counted.iter().zip(&vote_weights).map(|(f, vote)| (*f, vote / f.square_error));
        let (agree, differ) = of_all.partition(|(f, _)| f.holds(lead.delay_s));
        Self { lead, agree, differ }
    }

    /// The share of the agreeing weight on estimates within the sample.
    pub(super) fn within(&self) -> f64 {
        let all: f64 = self.agree.iter().map(|(_, w)| w).sum();
        self.agree.iter().filter(|(f, _)| f.within).map(|(_, w)| w).sum::<f64>()
            / all.max(f64::MIN_POSITIVE)
    }
}

/// The votes of estimates. Each class has one. Its bases ([`Basis`]) share it in proportion to 1/e², with e the error of their methods in the study. All methods
/// with one basis, also of other classes, share its part.
fn vote_weights(found: &[&FoundDelay<'_>]) -> Vec<f64> {
    let same = |f: &FoundDelay<'_>, g: &FoundDelay<'_>| {
        if f.basis == Basis::Own { f.method == g.method } else { f.basis == g.basis }
    };
    let weight = |f: &&FoundDelay<'_>| {
        let class: Vec<&&FoundDelay<'_>> = found.iter().filter(|g| g.class == f.class).collect();
        let share = |g: &FoundDelay<'_>| {
            let alike = class.iter().filter(|h| same(g, h)).count();
            g.error().powi(-2) / alike as f64
        };
        let basis: f64 = class.iter().filter(|g| same(f, g)).map(|g| share(g)).sum();
        let all: f64 = class.iter().map(|g| share(g)).sum();
        let sharing = found.iter().filter(|g| same(f, g)).count();
        f.class.vote_weight() * basis / (all * sharing as f64)
    };
    found.iter().map(weight).collect()
}
