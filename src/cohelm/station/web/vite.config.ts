import { defineConfig } from 'vite'

export default defineConfig({
  base: './',
  build: {
    outDir: '../static',
    emptyOutDir: true,
    target: 'es2022',
    // one script and one style: the server's content policy allows nothing else
    modulePreload: false,
    chunkSizeWarningLimit: 400,
  },


})
