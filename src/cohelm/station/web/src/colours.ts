// Grey is normal. Orange and blue of Okabe and Ito, which color-blind people can distinguish, mark the
// rest; never by color alone: a shape, a dash or a word means the same.
export const ink = '#22262a'
export const faint = '#8b9196'
export const warning = '#9c4a00'
export const danger = '#c00000'
export const operator = '#0059a8'
export const path = '#5d646b'
