//! Evaluation of accuracy: studies on rendered people, and scores of results against ground truth.
//!
//! Every table is computed by a function with fixed seeds: [`bodies::study`], [`tapes::study`], [`faults::study`],
//! [`ablation::study`], [`angles::study`], [`clothes::study`], [`folders::score_scan`], [`folders::score_photos`], and the experiments of [`published::run`].
//! The scores are defined in [`score`]. Rendered people differ from real ones: the studies locate weaknesses and measure the effect of
//! changes; they do not measure the accuracy on photos of real people.

pub mod ablation;
pub mod angles;
pub mod bodies;
pub mod clothes;
pub mod faults;
pub mod film;
pub mod folders;
pub mod people;
pub mod published;
pub mod score;
pub mod table;
pub mod tapes;
mod trial;
mod turn_errors;
pub mod videos;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use pirouette::pipeline::CancelToken;

pub use table::Table;

/// Progress of a study: the number of finished jobs, and the result of the last one
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Number of finished jobs
    pub done: usize,
    /// Number of all jobs
    pub total: usize,
    /// Result of the last job
    pub text: String,
}

/// Receives progress; calls are serialized but may come from any thread
pub type OnStep<'a> = dyn FnMut(Step) + Send + 'a;

/// Why a study has no table
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum StudyError {
    /// Cancellation was requested
    #[error("cancelled")]
    Cancelled,
    /// No people or no views
    #[error("the study has no people or no views; provide at least one of each")]
    Nothing,
    /// A part of a study that cannot be joined with the others
    #[error("part {} is {what}", index + 1)]
    Part {
        /// Index of the part
        index: usize,
        /// What it is instead
        what: &'static str,
    },
}

/// Runs all jobs on the threads of the current pool and returns the results in the order of the jobs
///
/// Each thread runs one job at a time. (A plain parallel loop would start further jobs while waiting for parts of the
/// first, and hold the memory of all of them.)
fn do_all<J: Sync, T: Send>(
    jobs: &[J],
    cancel: &CancelToken,
    on_step: &mut OnStep,
    work: impl Fn(&J) -> (T, String) + Sync,
) -> Result<Vec<T>, StudyError> {
    let next = AtomicUsize::new(0);
    let progress = Mutex::new((0, on_step));
    let lists = rayon::broadcast(|_| {
        let mut found = Vec::new();
        loop {
            let at = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(at).filter(|_| !cancel.cancelled()) else {
                return found;
            };
            let (result, text) = work(job);
            found.push((at, result));
            let (done, on_step) = &mut *progress.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            on_step(Step {
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
    fn results_are_in_the_order_of_the_jobs_and_every_job_is_reported() {
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
