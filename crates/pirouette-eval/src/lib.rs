//! How accurate pirouette is: studies on rendered people, and scores of results against truth.
//!
//! Every table is a function with fixed seeds: [`bodies::study`], [`tapes::study`], [`ablation::study`],
//! [`folders::score_scan`], [`folders::score_photos`], and the experiments of [`published::run`]. The definitions of the
//! scores are in [`score`]. Rendered people are not people: studies
//! find what is weak and what a change does, they are no claim about photos of anybody.

pub mod ablation;
pub mod bodies;
pub mod folders;
pub mod people;
pub mod published;
pub mod score;
pub mod table;
pub mod tapes;
mod trial;

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering};

use pirouette::pipeline::CancelToken;

pub use table::Table;

/// What a running study tells: how many of its jobs are done, and what the last one found
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Jobs that are done
    pub done: usize,
    /// All jobs
    pub total: usize,
    /// What was found
    pub text: String,
}

/// Hears of steps, one at a time but from any thread
pub type Tell<'a> = dyn FnMut(Step) + Send + 'a;

/// Why a study has no table
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum StudyError {
    /// Asked to stop
    #[error("cancelled")]
    Cancelled,
    /// There is nothing to average
    #[error("no people and no views, no table; give at least one of each")]
    Nothing,
}

/// Does all jobs on the threads of the current pool; results come back in the order of the jobs
///
/// Each thread has one job at a time (a plain parallel loop would begin others while it waits for parts of the
/// first, and pile up the memory of all).
fn do_all<J: Sync, T: Send>(
    jobs: &[J],
    cancel: &CancelToken,
    tell: &mut Tell,
    work: impl Fn(&J) -> (T, String) + Sync,
) -> Result<Vec<T>, StudyError> {
    let next = AtomicUsize::new(0);
    let told = Mutex::new((0, tell));
    let lists = rayon::broadcast(|_| {
        let mut found = Vec::new();
        loop {
            let at = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(at).filter(|_| !cancel.cancelled()) else {
                return found;
            };
            let (result, text) = work(job);
            found.push((at, result));
            let (done, tell) = &mut *told.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            tell(Step {
                done: *done,
                total: jobs.len(),
                text,
            });
        }
    });
    if cancel.cancelled() {
        return Err(StudyError::Cancelled);
    }
    let mut found: Vec<(usize, T)> = lists.into_iter().flatten().collect();
    found.sort_by_key(|(at, _)| *at);
    Ok(found.into_iter().map(|(_, result)| result).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_jobs_and_every_job_is_told() {
        let jobs: Vec<usize> = (0..50).collect();
        let mut steps = Vec::new();
        let found = do_all(
            &jobs,
            &CancelToken::default(),
            &mut |step| steps.push(step.done),
            |job| (job * 2, String::new()),
        );
        assert_eq!(found.unwrap(), (0..50).map(|i| 2 * i).collect::<Vec<_>>());
        assert_eq!(steps, (1..=50).collect::<Vec<_>>());
    }

    #[test]
    fn a_cancelled_study_has_no_table() {
        let cancel = CancelToken::default();
        cancel.cancel();
        let found = do_all(&[1], &cancel, &mut |_| {}, |_| ((), String::new()));
        assert_eq!(found.unwrap_err(), StudyError::Cancelled);
    }
}
