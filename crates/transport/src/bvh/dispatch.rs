//! Picks the vector instructions: the same code, compiled for what the machine has.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "calls of functions compiled for AVX2, after it was detected")
)]

use super::build::Tree;
use super::fan::{FAN, Fan};
use super::lanes::Portable;
use super::packet::Packet;
use super::stack::{Room, with_room};
use super::{Hit, Ray, traverse};

/// The instructions that traversal is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Instructions {
    /// Whatever the compilation target has.
    Baseline,
    /// 256-bit vectors and bit tricks of x86-64.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Instructions {
    /// The best of this machine.
    pub fn detect() -> Instructions {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") {
            return Instructions::Avx2;
        }
        Instructions::Baseline
    }
}

macro_rules! dispatched {
    ($name:ident, $argument:ty, $result:ty) => {
        pub(super) fn $name(with: Instructions, tree: &Tree, argument: &$argument) -> $result {
            with_room(tree.depth, |room| match with {
                Instructions::Baseline => baseline::$name(tree, argument, room),
                #[cfg(target_arch = "x86_64")]
                // SAFETY: this variant is only made by `detect`, where AVX2 and BMI1 were found.
                Instructions::Avx2 => unsafe { avx2::$name(tree, argument, room) },
            })
        }
    };
}

dispatched!(closest, Ray, Option<Hit>);
dispatched!(occluded, Ray, bool);
dispatched!(fan_occluded, Fan, u16);
dispatched!(packet_closest, Packet, [Option<Hit>; FAN]);

mod baseline {
    use super::*;

    pub fn closest(tree: &Tree, ray: &Ray, room: Room) -> Option<Hit> {
        traverse::closest::<Portable<8>, Portable<4>>(tree, ray, room)
    }

    pub fn occluded(tree: &Tree, ray: &Ray, room: Room) -> bool {
        traverse::occluded::<Portable<8>, Portable<4>>(tree, ray, room)
    }

    pub fn fan_occluded(tree: &Tree, fan: &Fan, room: Room) -> u16 {
        fan.occluded::<Portable<8>, Portable<4>>(tree, room)
    }

    pub fn packet_closest(tree: &Tree, packet: &Packet, room: Room) -> [Option<Hit>; FAN] {
        packet.closest::<Portable<8>, Portable<4>>(tree, room)
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::super::lanes::x86::{Lanes4, Lanes8};
    use super::*;

    #[target_feature(enable = "avx2,bmi1")]
    pub fn closest(tree: &Tree, ray: &Ray, room: Room) -> Option<Hit> {
        traverse::closest::<Lanes8, Lanes4>(tree, ray, room)
    }

    #[target_feature(enable = "avx2,bmi1")]
    pub fn occluded(tree: &Tree, ray: &Ray, room: Room) -> bool {
        traverse::occluded::<Lanes8, Lanes4>(tree, ray, room)
    }

    #[target_feature(enable = "avx2,bmi1")]
    pub fn fan_occluded(tree: &Tree, fan: &Fan, room: Room) -> u16 {
        fan.occluded::<Lanes8, Lanes4>(tree, room)
    }

    #[target_feature(enable = "avx2,bmi1")]
    pub fn packet_closest(tree: &Tree, packet: &Packet, room: Room) -> [Option<Hit>; FAN] {
        packet.closest::<Lanes8, Lanes4>(tree, room)
    }
}
