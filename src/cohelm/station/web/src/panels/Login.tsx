// Login with the token that the station printed at its start.
import { signal } from '@preact/signals'
import { logIn } from '../session'
import { retry } from '../socket'
import * as s from '../state'

/** Why the last login failed. */
export const wrong = signal('')

/** typed: the token, or all of the address it is in. */
async function login(typed: string): Promise<void> {
  wrong.value = await logIn(typed.trim().replace(/^.*token=/, ''))
  if (wrong.value === '') await retry()
}

export function Login() {
  return (
    <form
      class="login"
      onSubmit={(event) => {
        event.preventDefault()
        const field = event.currentTarget.elements.namedItem('token') as HTMLInputElement
        void login(field.value)
      }}
    >
      <h1>cohelm station</h1>
      <label>Token<input name="token" type="password" autocomplete="off" autofocus required /></label>
      {s.welcome.value !== null && (
        <p role="alert" class="abnormal">This page's login has ended: the station was started anew, and has another token.</p>
      )}
      <p>It is in the address that the station printed when it started: open that address, or copy it here.</p>
      <p role="alert" class="abnormal">{wrong.value}</p>
      {s.unsentStop.value && <p role="alert" class="abnormal">STOP is not sent yet: it will be when you have logged in.</p>}
      <button type="submit">Log in</button>
    </form>
  )
}
