//! Every key of the configuration with its unit and its reason: what `unwater config` prints.

/// A key of the configuration: its unit and why it is what it is.
pub struct Setting {
    /// `section.key`
    pub key: &'static str,
    /// unit, or the words it takes
    pub unit: &'static str,
    /// the reason
    pub why: &'static str,
}

macro_rules! settings {
    ($($key:literal, $unit:literal, $why:literal;)+) => { &[$(Setting { key: $key, unit: $unit, why: $why }),+] };
}

/// Every key with its unit and reason, in the order of the file.
#[rustfmt::skip]
pub const SETTINGS: &[Setting] = settings![
    "light.transfer", "auto | linear | srgb | gamma:G", "auto: JPEG, PNG-8 and 8-bit rgb/bgr/mono are sRGB-coded; bayer and 16 bit are linear";
    "light.white_level", "code", "full scale of 16-bit pictures; found from the bits their codes use where not given";
    "seafloor.pings_each_side", "pings", "more pings within the window mean less noise; a DVL gives 2 to 15 a second";
    "seafloor.ping_window_s", "s", "a height that curves in time is followed over this long; a ping farther off says little of the floor below the frame";
    "seafloor.max_ping_gap_s", "s", "a frame farther from any ping is not corrected";
    "seafloor.max_attitude_gap_s", "s", "attitude is not carried over a longer gap";
    "seafloor.least_altitude_m", "m", "a plane nearer to the lens is a fish or a fault";
    "seafloor.relief", "auto | off | on", "the DVL's hits along the track tell heights over the plane; auto: where they foretell hits that were left out";
    "matching.detection_side_px", "px", "keypoints are sought at this size at most; colours are pooled over more than a pixel";
    "matching.keypoints_per_frame", "count", "more points see the same few mean patches of floor";
    "matching.contrast_threshold", "log light", "in log light a threshold means the same at every brightness";
    "matching.ratio", "1", "Lowe's ratio of nearest to second nearest";
    "matching.neighbours", "frames", "all views of a point must stay in: thinned pairs bias the attenuation";
    "matching.inlier_px", "px at detection size", "distance to the homography of the pair";
    "matching.least_inliers", "count", "fewer agree by chance";
    "matching.footprint_px", "px", "standard deviation of the patch in the farther view; the same metres of seafloor in all views, or the log of the mean is biased";
    "estimate.estimator", "auto | joint | pairs | altitude", "joint where frames overlap, else pairs, else altitude";
    "estimate.spreading", "none | strobe | paper | fit", "the strobe's light falls with 1/ℓ_a² (Eq. 4); without it attenuation is only effective";
    "estimate.incidence", "true | false", "cos γ comes free from the plane";
    "estimate.strobe_position", "auto | fixed | refine | find", "0.2 m off doubles the residual and moves attenuation by 0.02 per metre; the log knows the place";
    "estimate.backscatter", "auto | off | on", "scattered light is added: unmodelled, it takes a sixth of the attenuation with it";
    "estimate.drift", "auto | off | on", "the water may change along the dive: attenuation at nodes in time";
    "estimate.first_frames", "frames", "pass one begins with so many, in stretches where the altitude changes most, one in each part of the log";
    "estimate.precision_per_m", "1/m", "standard deviation of attenuation that is enough; until then pass one takes twice as many frames, up to max_frames. 0: max_frames at once";
    "estimate.max_frames", "frames", "pass one's cost levels off as the dive gets longer; stretches are spread over the log";
    "estimate.attenuation_floor_per_m", "1/m", "the paper leaves out per-image values below 0.1; 0 keeps all";
    "estimate.sweeps", "count", "rounds of beam pattern and attenuation, 'we also recompute' (§IV-C)";
    "estimate.grid_step_px", "px at detection size", "blocks over which a frame is sampled for Eq. 17 and Fig. 6";
    "estimate.clipped_above", "share of full scale", "a clipped pixel is no measurement";
    "estimate.dark_below", "share of full scale", "the mean of a log is not the log of a mean: noise near black biases logs down";
    "estimate.beam_limit_deg", "deg", "the beam pattern's grid reaches from minus to plus this in θ and φ";
    "estimate.beam_nodes", "count", "nodes of that grid per axis";
    "estimate.beam_smoothness", "1", "weight of the grid's second differences against one observation; stiffer patterns pull the strobe's place by centimetres";
    "estimate.rounds", "count", "reweightings of the robust solve";
    "estimate.least_pairs", "count", "fewer matches do not hold three coefficients and a beam pattern";
    "estimate.least_altitude_spread", "ratio", "highest over lowest altitude below which attenuation is not identified";
    "render.method", "full | attenuation | beam-pattern | frame-average | range-average | grey-world | white-patch | homomorphic | homomorphic-surface | ahe", "what is removed (Fig. 10); from frame-average on they are baselines, for comparison (Fig. 4, Eq. 12 to 14)";
    "render.white_balance", "grey-world | none | [r, g, b]", "one per log, never per image";
    "render.highlight_quantile", "share", "one exposure per log: this share of the seafloor stays below highlight_level";
    "render.highlight_level", "share of white", "room above for single bright pixels";
    "render.shoulder_from", "share of white", "above it 8-bit pictures bend towards white instead of being cut off there; 1 cuts off. 16-bit ones are never bent";
    "render.gain_cap", "times the log's median gain", "beyond it a picture would show noise, not seafloor";
    "render.least_signal_to_noise", "1", "pixels whose light is less than this many times its known noise are counted in low_signal_share: a tenth of the value is noise there";
    "render.gain_error", "1", "the gain is evaluated on a grid and interpolated, so finely that it errs by no more than this share";
    "render.mask", "true | false", "a picture of bits beside each corrected one: clipped, gain capped, off the surface, unseen beam";
    "render.rectify", "true | false", "undo lens distortion as well (Fig. 2)";
    "render.image_format", "auto | jpeg | png | raw | same", "auto: PNG where the source is PNG or depth is 16, else JPEG";
    "render.jpeg_quality", "1 to 100", "95 hides nothing";
    "render.depth", "8 | 16", "8 is sRGB-coded, 16 is linear";
    "output.encoding", "auto | cdr | ros1 | protobuf", "of added messages. auto: protobuf where the camera's channel is, else CDR, which both viewers show";
    "output.compression", "auto | zstd | lz4 | none", "of chunks. auto: the input's as they are, none for JPEG, PNG and WebP, which gain nothing, zstd for all else; another: all chunks";
    "output.chunk_size_mib", "MiB", "a chunk should hold several frames";
    "output.drop_raw", "true | false", "leave out the corrected camera's own images";
    "output.only", "regex", "keep only topics that match; what unwater adds stays";
    "output.seafloor_points_across", "points", "the seafloor in the viewers' 3-D panels: points along a picture's width, 16 bytes each; 0: none";
    "output.raw_preview_side_px", "px", "raw pictures that a viewer cannot draw (16 bits, mono, packed) get an 8-bit picture for the eye, this large at most; 0: none";
];

/// An error of a TOML file, with the nearest known key where one was not known.
pub fn with_nearest_key<'k>(
    error: &toml::de::Error,
    known: impl Iterator<Item = &'k str>,
) -> String {
    let message = error.message();
    let unknown = message.strip_prefix("unknown field `").and_then(|rest| rest.split('`').next());
    let nearest = unknown.and_then(|unknown| {
        known
            .map(|key| {
                (
                    strsim::jaro_winkler(key.rsplit('.').next().unwrap_or(key), unknown)
                        .max(strsim::jaro_winkler(key, unknown)),
                    key,
                )
            })
            .max_by(|a, b| a.0.total_cmp(&b.0))
    });
    match (unknown, nearest) {
        (Some(unknown), Some((_, nearest))) => {
            format!("unknown key `{unknown}`; did you mean `{nearest}`?")
        }
        _ => error.to_string().trim().into(),
    }
}
