// Grey for what is normal. Orange and blue of Okabe and Ito, which colour-blind people tell apart,
// for what is not; never colour alone: a shape, a dash or a word says the same.
export const ink = '#22262a'
export const faint = '#8b9196'
export const warning = '#b45500'
export const danger = '#c00000'
export const person = '#0059a8'
export const path = '#5d646b'
