// The session that the login gave, sent with every request.
//
// It is stored where only pages of the same origin, port included, can read it. A cookie would be
// sent to every port of this machine, and with requests of other sites.
import { keep, kept } from './kept'

const KEY = 'cohelm.session'
let known: string | null = null

export function session(): string | null {
  return kept('localStorage', KEY) ?? known
}

/** `fetch` with the session. */
export function authorizedFetch(path: string, options: RequestInit = {}): Promise<Response> {
  return fetch(path, { ...options, cache: 'no-store', headers: { authorization: `Bearer ${session() ?? ''}` } })
}

/** Log in with the token; returns an error, or empty. */
export async function logIn(token: string): Promise<string> {
  let answer: Response
  try {
    answer = await fetch('./session', { method: 'POST', body: token })
  } catch {
    return 'The station does not answer.'
  }
  if (answer.ok) {
    known = await answer.text()
    keep('localStorage', KEY, known)
    return ''
  }
  return answer.status === 429 ? 'Too many wrong tokens; the right one still works.' : 'Wrong token.'
}

/** Calls back when another tab of this browser has logged in. */
export function onLogIn(then: () => void): void {
  addEventListener('storage', (event) => {
    if (event.key === KEY && event.newValue !== null) then()
  })
}
