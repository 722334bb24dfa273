//! Files from strangers: what reads them must not panic, hang, or ask for more memory than the file justifies.
//!
//! [`targets`] are what a fuzzer calls. [`mutate`] makes hostile files of small valid ones ([`seeds`]) from a seed, for
//! machines without a fuzzer: `cargo test hostile` in the main workspace, and the binary `drive` here, for minutes.

pub mod mutate;
pub mod seeds;
pub mod targets;
