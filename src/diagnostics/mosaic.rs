//! What a mosaic shows.

use super::facts;

facts! {
    /// Facts about a mosaic.
    MosaicFact {
        Info "mosaic-frames-chosen" FramesChosen { used: usize, frames: usize },
            text("{used} of {frames} frames, from the middle of the dive; -S and -E select others");
        Info "mosaic-frames-thinned" FramesThinned { step: usize, frames: usize },
            text("every {step}th frame, as the window has {frames}");
        Info "mosaic-poses" PosesFrom { source: String },
            text("poses from {source}");
        Info "mosaic-poses-from-matches" PosesFromMatches,
            text("poses from keypoint matches between neighbouring frames, as the log has neither \
                  odometry nor velocities");
        Info "mosaic-frames-not-connected" FramesNotConnected { used: usize, frames: usize },
            text("{used} of {frames} frames: the others are not connected to these");
        Info "mosaic-without-raw" NoRawImages,
            text("this log has no raw images: corrected strip only");
    }
}
