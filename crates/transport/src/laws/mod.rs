//! Laws of light transport, on scenes small enough for their answer to be known by hand or by brute force.

mod columns;
mod estimators;
mod leaks;
mod panes;
mod reference;
mod stage;
mod shadows;
mod walks;
