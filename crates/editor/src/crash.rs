//! What happens when the program itself is wrong: a report is kept in a file, and the window lives on.

use std::backtrace::Backtrace;
use std::fs;
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use crate::output::write_whole;

/// Reports that are kept.
const MAX_REPORTS: usize = 20;

/// Where the newest report of this process lies.
static NEWEST: Mutex<Option<PathBuf>> = Mutex::new(None);

/// From now on every panic leaves a report in `folder`, beside what it prints.
pub fn keep_reports(folder: PathBuf) {
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        print(panic);
        // A panic is no place for another failure: without a report, the words send to the terminal.
        *NEWEST.lock().unwrap_or_else(PoisonError::into_inner) = write_report(&folder, panic);
    }));
}

/// A sentence for people about a part of the program that panicked.
pub fn words() -> String {
    match &*NEWEST.lock().unwrap_or_else(PoisonError::into_inner) {
        Some(report) => {
            format!("it ended unexpectedly; please report it with the file {}", report.display())
        }
        None => "it ended unexpectedly; start the program from a terminal to see why, and please report it".into(),
    }
}

/// Does a job that may panic.
///
/// # Errors
/// If it did, [`words`].
pub fn guarded<T>(job: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(job)).map_err(|_| words())
}

/// Writes what is known of a panic, and lets go of the oldest reports; none where the folder cannot be written.
fn write_report(folder: &Path, panic: &PanicHookInfo<'_>) -> Option<PathBuf> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).ok()?;
    let thread = std::thread::current();
    let text = format!(
        "Clerestory {} on {} {}\nthread {}: {panic}\n\n{}\n",
        env!("CARGO_PKG_VERSION"),
        std::env::consts::OS,
        std::env::consts::ARCH,
        thread.name().unwrap_or("without a name"),
        Backtrace::force_capture(),
    );
    fs::create_dir_all(folder).ok()?;
    let path = folder.join(format!("panic-{:020}-{}.txt", now.as_nanos(), std::process::id()));
    write_whole(&path, text.as_bytes()).ok()?;
    let listed = fs::read_dir(folder).ok()?.flatten().map(|file| file.path());
    let mut reports: Vec<PathBuf> = listed.filter(|path| path.extension().is_some_and(|e| e == "txt")).collect();
    reports.sort();
    for oldest in reports.iter().rev().skip(MAX_REPORTS) {
        let _ = fs::remove_file(oldest);
    }
    Some(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_leaves_a_report_and_an_error_that_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let reports = folder.path().join("reports");
        fs::create_dir_all(&reports).unwrap();
        for old in 0..MAX_REPORTS + 5 {
            fs::write(reports.join(format!("panic-{old:020}-1.txt")), "old").unwrap();
        }
        keep_reports(reports.clone());
        assert_eq!(guarded(|| 7), Ok(7));
        let error = guarded(|| -> u32 { panic!("injected by a test") }).unwrap_err();
        assert!(error.contains("report it with the file"), "{error}");
        let files: Vec<PathBuf> = fs::read_dir(&reports).unwrap().flatten().map(|file| file.path()).collect();
        assert_eq!(files.len(), MAX_REPORTS);
        let texts: Vec<String> = files.iter().map(|file| fs::read_to_string(file).unwrap()).collect();
        let report = texts.iter().find(|text| text.contains("injected by a test")).expect("its report");
        assert!(report.contains("crash.rs") && report.contains(env!("CARGO_PKG_VERSION")), "{report}");
        // Later panics of this process have no such folder any more, and say so in the other words.
        drop(folder);
    }
}
