//! A bitmap font of 5 × 9 dots.
//!
//! Rows from the top, five bits each, the left dot in the highest bit; two rows are below the
//! baseline.

/// Width of a glyph (dots).
pub const WIDTH: usize = 5;
/// Height of a glyph (dots).
pub const HEIGHT: usize = 9;

/// Glyphs of ' ' to '~'.
#[rustfmt::skip]
const ASCII: [u64; 95] = [
    0x000000000000, 0x042108401000, 0x0a5000000000, 0x0a57d5f52800, 0x047d1c5f1000, //   ! " # $
    0x18c888898c00, 0x0c9511593400, 0x042000000000, 0x022210820800, 0x082084222000, // % & ' ( )
    0x00255d520000, 0x00213e420000, 0x000000063088, 0x00003e000000, 0x000000063000, // * + , - .
    0x010888884000, 0x0e8ceb98b800, 0x046108423800, 0x0e8844447c00, 0x1f110418b800, // / 0 1 2 3
    0x0232a5f10800, 0x1f878218b800, 0x06443d18b800, 0x1f0888842000, 0x0e8c5d18b800, // 4 5 6 7 8
    0x0e8c5e113000, 0x006300c60000, 0x006300c61100, 0x022220820800, 0x0007c1f00000, // 9 : ; < =
    0x082082222000, 0x0e8844401000, 0x0e8deb783c00, 0x0e8c7f18c400, 0x1e8c7d18f800, // > ? @ A B
    0x0e8c2108b800, 0x1c9463197000, 0x1f843d087c00, 0x1f843d084000, 0x0e8c2f18bc00, // C D E F G
    0x118c7f18c400, 0x0e2108423800, 0x071084293000, 0x119531494400, 0x108421087c00, // H I J K L
    0x11dd6b18c400, 0x118e6b38c400, 0x0e8c6318b800, 0x1e8c7d084000, 0x0e8c63593400, // M N O P Q
    0x1e8c7d494400, 0x0f841c10f800, 0x1f2108421000, 0x118c6318b800, 0x118c63151000, // R S T U V
    0x118c6b5dc400, 0x118a88a8c400, 0x118c54421000, 0x1f0888887c00, 0x0e4210843800, // W X Y Z [
    0x108208208400, 0x0e1084213800, 0x045440000000, 0x0000000003e0, 0x082000000000, // \ ] ^ _ `
    0x000382f8bc00, 0x1085b318f800, 0x0003a108b800, 0x010b6718bc00, 0x0003a3f83800, // a b c d e
    0x064a38842000, 0x0003e318bc2e, 0x1085b318c400, 0x040308423800, 0x020184210a4c, // f g h i j
    0x1084a98a4800, 0x0c2108423800, 0x0006ab5ad400, 0x0005b318c400, 0x0003a318b800, // k l m n o
    0x0007a318fa10, 0x0003e318bc21, 0x0005b3084000, 0x0003a0e0f800, 0x084710849800, // p q r s t
    0x00046319b400, 0x000463151000, 0x0004635aa800, 0x000454454400, 0x00046318bc2e, // u v w x y
    0x0007c4447c00, 0x022110420800, 0x042108421000, 0x082104422000, 0x000011510000, // z { | } ~
];

/// Bitmap of a character; a question mark for unknown ones.
pub fn glyph(c: char) -> u64 {
    match c {
        '°' => 0x0c9498000000,
        '±' => 0x00213e427c00,
        '×' => 0x000454454400,
        '−' | '–' => ASCII[usize::from(b'-' - b' ')],
        ' '..='~' => ASCII[(c as usize) - 32],
        _ => ASCII[usize::from(b'?' - b' ')],
    }
}

/// Whether the dot in `column` and `row` is set.
pub fn dot(glyph: u64, column: usize, row: usize) -> bool {
    glyph >> (WIDTH * HEIGHT - 1 - (row * WIDTH + column)) & 1 == 1
}
