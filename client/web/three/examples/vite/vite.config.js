export default {
  // else Vite's dev server copies lightwell.js away from its worker and WebAssembly; lightwell-three/inline
  // does without this
  optimizeDeps: { exclude: ['lightwell-three'] },
  build: { target: 'es2022' },
};
