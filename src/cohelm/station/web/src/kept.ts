// What the browser keeps for the pages of this origin, where it keeps anything.
type Where = 'localStorage' | 'sessionStorage'

export function kept(where: Where, key: string): string | null {
  try {
    return window[where].getItem(key)
  } catch {
    return null
  }
}

export function forget(where: Where, key: string): void {
  try {
    window[where].removeItem(key)
  } catch {
    // nothing is kept
  }
}

export function keep(where: Where, key: string, value: string): void {
  try {
    window[where].setItem(key, value)
  } catch {
    // used, but not kept: it lasts until the page is reloaded
  }
}
