//! The recording itself.

use super::facts;

facts! {
    /// Facts about a log as a file, and about its channels.
    LogFact {
        Info "messages-outside-chunks" OutsideChunks { messages: u64 },
            text("{messages} messages lie outside of chunks, without a checksum that would show \
                  damage; rerun shows none of them");
        Info "chunks-without-checksum" WithoutChecksum { chunks: usize, of: usize },
            text("{chunks} of {of} chunks have no checksum: damage inside them cannot be detected");
        Info "no-summary" NoSummary,
            text("there is no summary: other programs may show nothing, or ask to recover it. The \
                  corrected log has one");
        Info "schema-name-reused" SchemaNameReused { name: String, schemas: usize },
            text("{schemas} different schemas are named {name}; each channel is read by its own");
        Info "schema-known-by-name" SchemaKnown { name: String },
            text("the log has no definition of {name}; the usual one is used, which fits the \
                  channel's first message to its last byte");
        Info "several-channels" SeveralChannels { channels: usize },
            text("the topic has {channels} channels");
        Info "parts" Parts { parts: usize },
            text("{parts} files are read as the parts of one recording");
        Warning "parts-apart" PartsApart { before: String, after: String, gap_s: f64 },
            text("{gap_s:.0} s lie between the end of {before} and the begin of {after}, which are \
                  read as parts of one recording"),
            remedy("correct separate dives one by one, or name them otherwise than NAME_0.mcap, \
                    NAME_1.mcap");
        Warning "schema-missing" SchemaMissing { schema_id: u16 },
            text("schema {schema_id} is not in the log; the channel is kept without one"),
            remedy("check the recorder: only messages with a schema can be read");
        Warning "messages-not-readable" MessagesUnreadable { messages: u64, reason: String },
            text("cannot read {messages} messages: {reason}"),
            remedy("`unwater inspect` lists what is read; docs/messages.md the types");
        Warning "schema-not-readable" SchemaUnreadable { reason: String },
            text("cannot read the channel: {reason}"),
            remedy("`unwater inspect` lists what is read; docs/messages.md the types");
        Loss "camera-left-out" CameraLeftOut { reason: String },
            text("the camera is not corrected: {reason}"),
            remedy("correct it alone with --camera <topic>");
        Loss "damage" Damage { places: usize },
            text("places of the log that cannot be read: {places}"),
            remedy("look for an undamaged copy; all else is in the output");
    }
}
