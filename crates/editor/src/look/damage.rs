//! JSON that was cut off or spoiled: the longest part before the damage that can be closed into a document.

use std::collections::VecDeque;

use serde_json::{Error, Value};

use super::place::after_string;

/// A place where the text may be cut, and the brackets that are open there.
struct Cut {
    end: usize,
    open: Vec<u8>,
}

/// What stands before an error of syntax, its brackets closed, as text and as a document; `None` if there is nothing.
pub(super) fn readable(text: &str, error: &Error) -> Option<(String, Value)> {
    let end = offset_of(text, error);
    let cuts = cuts(&text.as_bytes()[..end]);
    // The last one that makes a document holds the most.
    cuts.iter().rev().find_map(|cut| {
        let closing: String = cut.open.iter().rev().map(|open| if *open == b'{' { '}' } else { ']' }).collect();
        let closed = format!("{}{closing}", text.get(..cut.end)?);
        let value: Value = serde_json::from_str(&closed).ok()?;
        value.is_object().then_some((closed, value))
    })
}

/// Byte at which an error was seen; lines and columns of the parser count bytes from 1.
#[expect(clippy::arithmetic_side_effects, reason = "places in a text of at most `MAX_BYTES`")]
fn offset_of(text: &str, error: &Error) -> usize {
    let line_start: usize = text.split_inclusive('\n').take(error.line().saturating_sub(1)).map(str::len).sum();
    (line_start + error.column()).min(text.len())
}

/// Behind every opening and closing bracket and before every comma; the last ones.
#[expect(clippy::arithmetic_side_effects, reason = "places in a text of at most `MAX_BYTES`")]
fn cuts(text: &[u8]) -> VecDeque<Cut> {
    let (mut cuts, mut open, mut at) = (VecDeque::new(), Vec::new(), 0);
    while let Some(&byte) = text.get(at) {
        let mut end = at + 1;
        match byte {
            b'"' => match after_string(text, at) {
                Some(after) => {
                    at = after;
                    continue;
                }
                None => break,
            },
            b'{' | b'[' => open.push(byte),
            b'}' | b']' => drop(open.pop()),
            b',' => end = at,
            _ => {
                at += 1;
                continue;
            }
        }
        // A document deeper than that is no look.
        if open.len() > MAX_DEPTH {
            break;
        }
        if cuts.len() == MAX_CUTS {
            cuts.pop_front();
        }
        cuts.push_back(Cut { end, open: open.clone() });
        at += 1;
    }
    cuts
}

/// Deepest nesting of a look, and more.
const MAX_DEPTH: usize = 32;
/// Most places that are tried.
const MAX_CUTS: usize = 16;
