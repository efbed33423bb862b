//! Checks the nesting of brackets in a text before anything is stored.

use crate::token::{ParseSession, SourcePlace};
use osier_base::diagnostic::{SourceId, Span};
use osier_base::limits::{Limits, grouped};

/// L004 and true if a text nests more brackets than the turtle allows (`turtle-stack`): storing a million of them would take
/// hundreds of bytes each before the turtle refused them.
pub(crate) fn check_nesting(session: &mut ParseSession, source: SourceId, text: &str, limits: &Limits) -> bool {
    let most = limits.get("turtle-stack");
    let mut open = 0_u64;
    for (i, b) in text.bytes().enumerate() {
        match b {
            b'[' => open += 1,
            b']' => open = open.saturating_sub(1),
            _ => continue,
        }
        if open > most {
            let place = SourcePlace::bare(Span::new(source, i, i + 1));
            let message = format!("more than {} brackets are open here", grouped(most));
            session.error_help(
                "L004",
                message,
                place,
                "close them with ']', or raise the limit with --max-turtle-stack",
            );
            return true;
        }
    }
    false
}
