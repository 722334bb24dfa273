//! Where in the text of a JSON document a member stands, for people who edit it by hand.

use std::fmt;

use anyhow::Error;

/// A step down into a document.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Member of an object.
    Key(String),
    /// Item of a list.
    Item(usize),
}

impl From<&str> for Step {
    fn from(key: &str) -> Step {
        Step::Key(key.to_owned())
    }
}

impl From<usize> for Step {
    fn from(item: usize) -> Step {
        Step::Item(item)
    }
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Step::Key(key) => f.write_str(key),
            Step::Item(item) => write!(f, "[{item}]"),
        }
    }
}

/// What people call a place.
pub(super) fn path(steps: &[Step]) -> String {
    let mut path = String::new();
    for step in steps {
        let separator = if path.is_empty() || matches!(step, Step::Item(_)) { "" } else { "." };
        path = format!("{path}{separator}{step}");
    }
    path
}

/// A complaint that says where.
#[derive(Debug)]
struct Located(String);

impl fmt::Display for Located {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Located {}

/// Adds line and column to a complaint about a member, unless a deeper one has done so.
pub(super) fn located(error: Error, text: &str, steps: &[Step]) -> Error {
    if error.is::<Located>() {
        return error;
    }
    match offset(text.as_bytes(), steps) {
        Some(offset) => {
            let (line, column) = line_and_column(text, offset);
            Located(format!("line {line}, column {column}: {error:#}")).into()
        }
        None => error,
    }
}

/// Both from 1; columns count characters.
#[expect(clippy::arithmetic_side_effects, reason = "places in a text of at most `MAX_BYTES`")]
pub(super) fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = &text.as_bytes()[..offset];
    let start = before.iter().rposition(|&b| b == b'\n').map_or(0, |at| at + 1);
    let line = 1 + before.iter().filter(|&&b| b == b'\n').count();
    (line, 1 + String::from_utf8_lossy(&before[start..]).chars().count())
}

/// Where the value of a member begins in valid JSON; of members of one name the last, which is the one that counts.
pub(super) fn offset(text: &[u8], steps: &[Step]) -> Option<usize> {
    let mut at = after_space(text, 0);
    for step in steps {
        at = member(text, at, step)?;
    }
    Some(at)
}

#[expect(clippy::arithmetic_side_effects, reason = "places in a text of at most `MAX_BYTES`")]
fn member(text: &[u8], start: usize, step: &Step) -> Option<usize> {
    let (mut at, mut nth, mut found) = (after_space(text, start + 1), 0, None);
    while !matches!(text.get(at)?, b'}' | b']') {
        let key_end = match text[start] {
            b'{' => after_value(text, at)?,
            _ => at,
        };
        let is_it = match step {
            Step::Key(key) => serde_json::from_slice::<String>(&text[at..key_end]).is_ok_and(|name| name == *key),
            Step::Item(item) => nth == *item,
        };
        if text[start] == b'{' {
            // The colon.
            at = after_space(text, after_space(text, key_end) + 1);
        }
        found = if is_it { Some(at) } else { found };
        // Text that is not valid after all must not hold anybody up.
        let end = after_value(text, at).filter(|end| *end > at)?;
        at = after_space(text, end);
        if *text.get(at)? == b',' {
            at = after_space(text, at + 1);
        }
        nth += 1;
    }
    found
}

#[expect(clippy::arithmetic_side_effects, reason = "places in a text of at most `MAX_BYTES`")]
fn after_space(text: &[u8], at: usize) -> usize {
    at + text.get(at..).unwrap_or_default().iter().take_while(|byte| byte.is_ascii_whitespace()).count()
}

/// The end of the value that begins at a place.
#[expect(clippy::arithmetic_side_effects, reason = "places in a text of at most `MAX_BYTES`")]
fn after_value(text: &[u8], start: usize) -> Option<usize> {
    let (mut depth, mut at) = (0_usize, start);
    loop {
        match *text.get(at)? {
            b'"' => at = after_string(text, at)?,
            b'{' | b'[' => (depth, at) = (depth + 1, at + 1),
            b'}' | b']' => (depth, at) = (depth.checked_sub(1)?, at + 1),
            _ if depth == 0 => return Some(at + text[at..].iter().take_while(|b| is_plain(**b)).count()),
            _ => at += 1,
        }
        if depth == 0 {
            return Some(at);
        }
    }
}

/// Whether a byte can be part of a number or of `true`, `false` and `null`.
fn is_plain(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'-' | b'.')
}

/// Behind the closing quotation mark; `None` if there is none.
#[expect(clippy::arithmetic_side_effects, reason = "places in a text of at most `MAX_BYTES`")]
pub(super) fn after_string(text: &[u8], start: usize) -> Option<usize> {
    let mut at = start + 1;
    while *text.get(at)? != b'"' {
        at += if text[at] == b'\\' { 2 } else { 1 };
    }
    Some(at + 1)
}
