// The session: what this page got for the token, and shows with every request.
//
// It is kept where only pages of this very origin, port included, can read it. A cookie would be
// sent to every port of this machine, and along with what other pages ask for.
const KEY = 'cohelm.session'
let known: string | null = null

export function session(): string | null {
  try {
    return localStorage.getItem(KEY) ?? known
  } catch {
    return known // a browser that keeps nothing: until the page is loaded again
  }
}

function keep(given: string): void {
  known = given
  try {
    localStorage.setItem(KEY, given)
  } catch {
    // see above
  }
}

/** The same as fetch, with the session. */
export function ask(path: string, options: RequestInit = {}): Promise<Response> {
  return fetch(path, { ...options, cache: 'no-store', headers: { authorization: `Bearer ${session() ?? ''}` } })
}

/** Show the token; what is wrong, or nothing. */
export async function enter(token: string): Promise<string> {
  let answer: Response
  try {
    answer = await fetch('./session', { method: 'POST', body: token })
  } catch {
    return 'The station does not answer.'
  }
  if (answer.ok) {
    keep(await answer.text())
    return ''
  }
  return answer.status === 429 ? 'Too many wrong tokens.' : 'That is not the token.'
}

/** Told when another tab of this browser has come in. */
export function onEntered(then: () => void): void {
  addEventListener('storage', (event) => {
    if (event.key === KEY && event.newValue !== null) then()
  })
}
