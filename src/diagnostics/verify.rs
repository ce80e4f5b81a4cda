//! What a verification finds.

use super::facts;

facts! {
    /// Facts about a corrected log, compared with what it must be.
    VerifyFact {
        Loss "verify-damage" Damaged { reason: String },
            text("the log is damaged: {reason}");
        Loss "verify-attachment" AttachmentChanged { name: String },
            text("{name} is not the one that was written with this log");
        Loss "verify-other-input" OtherInput { recorded: String, given: String },
            text("it was made from another input: its record has SHA-256 {recorded}, the input \
                  given has {given}");
        Loss "verify-channel-missing" ChannelMissing { id: u16 },
            text("the channel {id} of the input is missing or declared otherwise");
        Loss "verify-messages" MessagesDiffer { found: u64, expected: u64, first_ns: u64 },
            text("messages of the input are missing or changed: {found} of {expected} are there, \
                  and from log time {first_ns} on they differ");
        Loss "verify-input-record" RecordMissing { name: String },
            text("{name} of the input is missing or changed");
        Loss "verify-not-reproduced" NotReproduced { messages: u64, of: u64, first_ns: u64 },
            text("{messages} of {of} messages do not follow from the raw frames and the model, the \
                  first at log time {first_ns}");
        Warning "verify-other-version" OtherVersion { version: String, own: String },
            text("it was written by version {version}, and this is {own}: the bytes may differ for \
                  that reason"),
            remedy("verify it with version {version}");
        Warning "verify-not-repeated" NotRepeated { reason: String },
            text("the corrected frames were not compared: {reason}");
    }
}
