//! What a traversal still has to visit.
#![expect(
    unsafe_code,
    reason = "clearing or checking the stack would cost a tenth of a ray; the depth of the tree bounds it"
)]

use std::mem::MaybeUninit;

use super::node::{Child, WIDTH};

/// An entry: the bits of the distance at which the ray enters (non-negative, so they sort as numbers), then the child.
pub(super) type Entry = u64;

/// Entries that suffice for a tree of 31 levels; deeper ones are rare and get theirs from the heap.
const ON_STACK: usize = 256;

/// Entries that a traversal can need: each level leaves all its children but one, the last all of them.
fn most_entries(depth: usize) -> usize {
    (WIDTH - 1) * depth + WIDTH
}

/// Calls `visit` with room for every entry that a tree of this many levels can need.
#[inline(always)]
pub(super) fn with_room<R>(depth: usize, visit: impl FnOnce(Room) -> R) -> R {
    if most_entries(depth) <= ON_STACK {
        visit(Room(&mut [const { MaybeUninit::uninit() }; ON_STACK]))
    } else {
        visit(Room(&mut vec![MaybeUninit::uninit(); most_entries(depth)]))
    }
}

/// Memory for the entries; long enough for the tree it was made for.
pub(super) struct Room<'a>(&'a mut [MaybeUninit<Entry>]);

impl Room<'_> {
    /// The same room for one traversal of several.
    #[inline(always)]
    pub fn lent(&mut self) -> Room<'_> {
        Room(self.0)
    }
}

/// Last in, first out.
pub(super) struct Stack<'a> {
    room: Room<'a>,
    len: usize,
}

impl<'a> Stack<'a> {
    /// Nothing to visit yet.
    #[inline(always)]
    pub fn new(room: Room<'a>) -> Self {
        Stack { room, len: 0 }
    }

    /// Number of entries.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Adds an entry on top.
    #[inline(always)]
    pub fn push(&mut self, entry: Entry) {
        debug_assert!(self.len < self.room.0.len(), "a tree deeper than it was said to be");
        // SAFETY: `with_room` made room for as many entries as the depth of the tree allows.
        unsafe { self.room.0.get_unchecked_mut(self.len) }.write(entry);
        self.len += 1;
    }

    /// Adds an entry above `floor`, where the entries fall towards the top, and keeps them falling.
    #[inline(always)]
    pub fn insert(&mut self, entry: Entry, floor: usize) {
        let mut at = self.len;
        while at > floor && self.get(at - 1) < entry {
            let moved = self.get(at - 1);
            self.set(at, moved);
            at -= 1;
        }
        self.set(at, entry);
        self.len += 1;
    }

    /// Takes the entry on top.
    #[inline(always)]
    pub fn pop(&mut self) -> Option<Entry> {
        self.len = self.len.checked_sub(1)?;
        Some(self.get(self.len))
    }

    #[inline(always)]
    fn get(&self, at: usize) -> Entry {
        // SAFETY: the callers ask below the top, and all there was written.
        unsafe { self.room.0.get_unchecked(at).assume_init() }
    }

    #[inline(always)]
    fn set(&mut self, at: usize, entry: Entry) {
        // SAFETY: as for `push`, `at` is at most the top.
        unsafe { self.room.0.get_unchecked_mut(at) }.write(entry);
    }
}

/// An entry for a child that the ray enters at `near` (non-negative).
#[inline(always)]
pub(super) fn entry(near: f32, child: Child) -> Entry {
    u64::from(near.to_bits()) << 32 | u64::from(child.bits())
}

/// Where the ray enters, and what.
#[inline(always)]
pub(super) fn unpack(entry: Entry) -> (f32, Child) {
    (f32::from_bits((entry >> 32) as u32), Child::from_bits(entry as u32))
}
