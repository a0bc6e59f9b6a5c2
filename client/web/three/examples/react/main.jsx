// Shows public/scene.glb in the light of the lightwelld at ws://127.0.0.1:7781/ws, by React-three-fiber.
// lightwell-three/inline needs no settings of the bundler.
import { StrictMode, Suspense, useEffect, useRef, useState } from 'react';
import { createRoot } from 'react-dom/client';
import { Canvas, useFrame, useLoader } from '@react-three/fiber';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { Lightwell } from 'lightwell-three/inline';

const parameters = new URLSearchParams(location.search);

/** A glTF in live light. onText: gets what a person should know. */
function Lit({ url, server, onText }) {
  const { scene } = useLoader(GLTFLoader, url);
  const current = useRef(null);
  useEffect(() => {
    const stop = new AbortController();
    Lightwell.attach(scene, server, { signal: stop.signal, onState: (_, text) => onText(text) }).then(
      (light) => (current.current = light),
      (error) => stop.signal.aborted || onText(error.message),
    );
    return () => {
      stop.abort(); // before the first light
      current.current?.dispose(); // after it
      current.current = null;
    };
  }, [scene, server, onText]);
  useFrame(({ camera, gl }) => {
    current.current?.update(camera, gl.domElement.height);
    globalThis.example = { light: current.current, scene, camera, renderer: gl };
  });
  return <primitive object={scene} />;
}

function App() {
  const [text, setText] = useState('');
  return (
    <>
      <div role="status">{text}</div>
      <Canvas
        shadows
        camera={{ fov: 60, position: [1.5, 1.7, 2.2] }}
        onCreated={({ camera }) => camera.lookAt(-0.2, 1, -1)}
      >
        <Suspense>
          <Lit
            url={parameters.get('scene') ?? 'scene.glb'}
            server={parameters.get('server') ?? 'ws://127.0.0.1:7781/ws'}
            onText={setText}
          />
        </Suspense>
      </Canvas>
    </>
  );
}

createRoot(document.getElementById('root')).render(
  <StrictMode>
    <App />
  </StrictMode>,
);
