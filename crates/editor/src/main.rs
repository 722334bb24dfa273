//! The binary: everything is in the library, where tests can drive it.

use std::process::ExitCode;

use clerestory::cli::{Interrupt, run_until};
use clerestory::platform::outlive_limits_of_files;

fn main() -> ExitCode {
    outlive_limits_of_files();
    run_until(Interrupt::of_process(), std::env::args_os(), &mut std::io::stdout(), &mut std::io::stderr())
}
